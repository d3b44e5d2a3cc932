"""What every Gaussian filter shares: the conditional Gaussian, the loop over the instants, the result.

Source: the optimal linear recursion, UKF chapter eqs. 7.14-7.18; log-likelihood by the innovations (Schweppe 1965).
A `Transform` maps (g, m, P) to the mean and covariance of g(x) and the covariance of x with g(x), x ~ N(m, P).
"""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
First = Literal["update", "predict"]
Function = Callable[..., Any]


class Moments(NamedTuple):
    mean: Array  # (d,)    E g(x)
    cov: Array  # (d, d)  Cov g(x)
    cross: Array  # (n, d)  Cov(x, g(x))


Transform = Callable[[Function, Array, Array], Moments]


class Belief(NamedTuple):
    mean: Array  # (n,)
    cov: Array  # (n, n)
    points: Any = None  # what a prediction hands to the next update when sigma points are not redrawn


class Update(NamedTuple):
    mean: Array  # (n,)
    cov: Array  # (n, n)
    innovation: Array  # (m,)    NaN where not measured
    innovation_cov: Array  # (m, m)  of all elements, measured or not
    nis: float  # 0 when nothing was measured
    log_density: float


class FilterResult(NamedTuple):
    mean: Array  # (T, n)     given y up to and with the row's own instant
    cov: Array  # (T, n, n)
    predicted_mean: Array  # (T, n)     given y before the row's own instant
    predicted_cov: Array  # (T, n, n)
    innovation: Array  # (T, m)
    innovation_cov: Array  # (T, m, m)
    nis: Array  # (T,)
    log_likelihood: float


def symmetric(P: Array) -> Array:
    return 0.5 * (P + P.T)


def vector(value: Any) -> Array:
    """A function value, NumPy or not, as a float64 vector."""
    return np.atleast_1d(np.asarray(value, dtype=np.float64))


def row(tree: Any, k: int) -> Any:
    """Row k of every leaf of a tree of dicts, tuples and arrays; None stays None."""
    if tree is None:
        return None
    if isinstance(tree, dict):
        return {name: row(leaf, k) for name, leaf in tree.items()}
    if isinstance(tree, (tuple, list)):
        return type(tree)(row(leaf, k) for leaf in tree)
    return tree[k]


def noise_at(Q: Array, k: int) -> Array:
    """The covariance at instant k of a constant (n, n) or a varying (T, n, n) noise."""
    Q = np.asarray(Q, dtype=np.float64)
    return Q[k] if Q.ndim == 3 else Q


def innovation_statistics(e: Array, S: Array) -> tuple[float, float]:
    """The squared Mahalanobis length of e and its log density under N(0, S)."""
    nis = float(e @ np.linalg.solve(S, e)) if e.size else 0.0
    log_determinant = float(np.linalg.slogdet(S)[1]) if e.size else 0.0
    return nis, -0.5 * (nis + log_determinant + e.size * np.log(2.0 * np.pi))


def condition(m: Array, P: Array, y_mean: Array, S: Array, C: Array, y: Array) -> Update:
    """The belief about x after y, with y_mean, S = Cov(y), C = Cov(x, y): UKF chapter eqs. 7.61-7.63."""
    seen = ~np.isnan(y)
    e, S_seen, C_seen = (y - y_mean)[seen], S[np.ix_(seen, seen)], C[:, seen]
    K = np.linalg.solve(S_seen, C_seen.T).T
    nis, log_density = innovation_statistics(e, S_seen)
    return Update(m + K @ e, symmetric(P - K @ S_seen @ K.T), y - y_mean, S, nis, log_density)


def run(
    predict: Callable[[Belief, int], Belief],
    update: Callable[[Belief, Array, int], Update],
    m0: Array,
    P0: Array,
    y: Array,
    first: First = "update",
) -> FilterResult:
    """Predict and update by turns; `predict(belief, k)` leaves instant k, `update(belief, y_k, k)` is at instant k."""
    belief = Belief(np.asarray(m0, dtype=np.float64), np.asarray(P0, dtype=np.float64))
    start = {"update": 0, "predict": 1}[first]
    priors, updates = [], []
    for k, y_k in enumerate(np.asarray(y, dtype=np.float64), start=start):
        if k > 0:
            belief = predict(belief, k - 1)
        priors.append(belief)
        updates.append(update(belief, y_k, k))
        belief = Belief(updates[-1].mean, updates[-1].cov)
    mean, cov, innovation, innovation_cov, nis, log_density = (
        np.array(column) for column in zip(*updates, strict=True)
    )
    predicted_mean, predicted_cov = (np.array([prior[i] for prior in priors]) for i in (0, 1))
    return FilterResult(
        mean, cov, predicted_mean, predicted_cov, innovation, innovation_cov, nis, float(np.sum(log_density))
    )


def predicted(moments: Moments, Q: Array) -> Belief:
    """Additive process noise: UKF chapter eq. 7.55."""
    return Belief(moments.mean, symmetric(moments.cov + Q))


def updated(belief: Belief, moments: Moments, R: Array, y: Array) -> Update:
    """Additive measurement noise: UKF chapter eqs. 7.59-7.63."""
    return condition(belief.mean, belief.cov, moments.mean, symmetric(moments.cov + R), moments.cross, y)


def additive_filter(
    transform: Transform,
    f: Function,
    h: Function,
    Q: Array,
    R: Array,
    m0: Array,
    P0: Array,
    y: Array,
    u: Any = None,
    first: First = "update",
) -> FilterResult:
    """Table 7.3.2 with any transform: x[k+1] = f(x, u) + N(0, Q), y[k] = h(x, u) + N(0, R), points redrawn for h."""

    def predict(belief: Belief, k: int) -> Belief:
        moments = transform(lambda x: f(x, row(u, k)), belief.mean, belief.cov)
        return predicted(moments, noise_at(Q, k))

    def update(belief: Belief, y_k: Array, k: int) -> Update:
        moments = transform(lambda x: h(x, row(u, k)), belief.mean, belief.cov)
        return updated(belief, moments, noise_at(R, k), y_k)

    return run(predict, update, m0, P0, y, first)
