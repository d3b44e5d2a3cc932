"""The unscented transform and three unscented Kalman filters: additive, augmented, and with the extended set.

Source: E. A. Wan and R. van der Merwe, "The Unscented Kalman Filter", chapter 7 of "Kalman Filtering and Neural
Networks", 2001: eqs. 7.30-7.34, Tables 7.3.1 and 7.3.2, footnote 6.
Square roots are lower Cholesky factors; a set of sigma points is (2L+1, L).
"""

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from .gaussian import (
    Array,
    Belief,
    FilterResult,
    First,
    Function,
    Moments,
    Update,
    additive_filter,
    condition,
    noise_at,
    row,
    run,
    symmetric,
    vector,
)


class Weights(NamedTuple):
    mean: Array  # (2L+1,)
    cov: Array  # (2L+1,)
    gamma: float


def scaled_weights(L: int, alpha: float, beta: float, kappa: float) -> Weights:
    """Weights and spread gamma = sqrt(L + lambda) for dimension L: eq. 7.34."""
    lam = alpha**2 * (L + kappa) - L
    mean = np.full(2 * L + 1, 1.0 / (2.0 * (L + lam)))
    mean[0] = lam / (L + lam)
    cov = mean.copy()
    cov[0] = lam / (L + lam) + (1.0 - alpha**2 + beta)
    return Weights(mean, cov, float(np.sqrt(L + lam)))


def sigma_points(m: Array, P: Array, gamma: float) -> Array:
    """m, m + gamma sqrt(P)_i, m - gamma sqrt(P)_i as rows: eq. 7.30."""
    spread = gamma * np.linalg.cholesky(P).T
    return np.vstack([m, m + spread, m - spread])


def weighted_mean(points: Array, weights: Weights) -> Array:
    """Eq. 7.32."""
    return weights.mean @ points


def weighted_cov(X: Array, x_mean: Array, Y: Array, y_mean: Array, weights: Weights) -> Array:
    """Sum of W_i (X_i - x)(Y_i - y)': eqs. 7.33 and 7.46."""
    return (X - x_mean).T @ (weights.cov[:, None] * (Y - y_mean))


def unscented_transform(
    g: Function, m: Array, P: Array, alpha: float = 1.0, beta: float = 2.0, kappa: float = 0.0
) -> Moments:
    """Mean and covariance of g(x), and its covariance with x, for x ~ (m, P): eqs. 7.30-7.34."""
    weights = scaled_weights(m.size, alpha, beta, kappa)
    X = sigma_points(m, P, weights.gamma)
    Y = np.array([vector(g(point)) for point in X])
    mean = weighted_mean(Y, weights)
    return Moments(mean, weighted_cov(Y, mean, Y, mean, weights), weighted_cov(X, m, Y, mean, weights))


def additive_ukf(
    f: Function,
    h: Function,
    Q: Array,
    R: Array,
    m0: Array,
    P0: Array,
    y: Array,
    u: Any = None,
    alpha: float = 1.0,
    beta: float = 2.0,
    kappa: float = 0.0,
    first: First = "update",
) -> FilterResult:
    """Table 7.3.2: x[k+1] = f(x, u) + v, y = h(x, u) + n, sigma points redrawn before h."""
    transform = partial(unscented_transform, alpha=alpha, beta=beta, kappa=kappa)
    return additive_filter(transform, f, h, Q, R, m0, P0, y, u, first)


def update_with_set(belief: Belief, X: Array, Y: Array, weights: Weights, R: Array | float, y: Array) -> Update:
    """Eqs. 7.44-7.49 from the points X and their images Y; R is 0 when the set already carries the noise."""
    y_mean = weighted_mean(Y, weights)
    S = symmetric(weighted_cov(Y, y_mean, Y, y_mean, weights) + R)
    C = weighted_cov(X, belief.mean, Y, y_mean, weights)
    return condition(belief.mean, belief.cov, y_mean, S, C, y)


def belief_of_set(X: Array, weights: Weights, points: Any) -> Belief:
    """Eqs. 7.41-7.42; `points` travel on to the update."""
    mean = weighted_mean(X, weights)
    return Belief(mean, symmetric(weighted_cov(X, mean, X, mean, weights)), points)


def block_diagonal(*blocks: Array) -> Array:
    size = sum(len(block) for block in blocks)
    out, start = np.zeros((size, size)), 0
    for block in blocks:
        stop = start + len(block)
        out[start:stop, start:stop] = block
        start = stop
    return out


def augmented_set(m: Array, P: Array, Q: Array, R: Array, gamma: float) -> tuple[Array, Array, Array]:
    """The x, v and n parts of the sigma points of (x, v, n): eqs. 7.37-7.39."""
    n, q, r = len(m), len(Q), len(R)
    X = sigma_points(np.concatenate([m, np.zeros(q + r)]), block_diagonal(P, Q, R), gamma)
    return X[:, :n], X[:, n : n + q], X[:, n + q :]


def augmented_ukf(
    f: Function,
    h: Function,
    Q: Array,
    R: Array,
    m0: Array,
    P0: Array,
    y: Array,
    u: Any = None,
    alpha: float = 1.0,
    beta: float = 2.0,
    kappa: float = 0.0,
    first: First = "predict",
) -> FilterResult:
    """Table 7.3.1: x[k+1] = f(x, u, v), y = h(x, u, n), one set of (x, v, n) through f and then h, no redraw.

    With `first="update"` the first update draws an augmented set from the initial belief and does not use its v part.
    """
    size = len(m0) + noise_at(Q, 0).shape[0] + noise_at(R, 0).shape[0]
    weights = scaled_weights(size, alpha, beta, kappa)

    def predict(belief: Belief, k: int) -> Belief:
        X, V, N = augmented_set(belief.mean, belief.cov, noise_at(Q, k), noise_at(R, k + 1), weights.gamma)
        X = np.array([vector(f(x, row(u, k), v)) for x, v in zip(X, V, strict=True)])
        return belief_of_set(X, weights, (X, N))

    def update(belief: Belief, y_k: Array, k: int) -> Update:
        if belief.points is None:
            X, _, N = augmented_set(belief.mean, belief.cov, noise_at(Q, k), noise_at(R, k), weights.gamma)
        else:
            X, N = belief.points
        Y = np.array([vector(h(x, row(u, k), n)) for x, n in zip(X, N, strict=True)])
        return update_with_set(belief, X, Y, weights, 0.0, y_k)

    return run(predict, update, m0, P0, y, first)


def extended_set_ukf(
    f: Function,
    h: Function,
    Q: Array,
    R: Array,
    m0: Array,
    P0: Array,
    y: Array,
    u: Any = None,
    alpha: float = 1.0,
    beta: float = 2.0,
    kappa: float = 0.0,
    first: First = "update",
    fresh_dimension: int | None = None,
) -> FilterResult:
    """Footnote 6 of Table 7.3.2: the propagated set, extended by X*_0 +- gamma sqrt(Q), goes through h, no redraw.

    Weights and gamma are those of dimension 2n, for the points that go through f too: with the gamma of dimension n and
    the weights of 2n their spread would not be that of P. So this is Table 7.3.1 with the noise v alone augmented.
    `fresh_dimension`: the dimension whose weights are used at an update before any prediction; 2n (default) or n.
    """
    n = len(m0)
    weights = scaled_weights(2 * n, alpha, beta, kappa)
    fresh = scaled_weights(fresh_dimension or 2 * n, alpha, beta, kappa)

    def predict(belief: Belief, k: int) -> Belief:
        X = sigma_points(belief.mean, belief.cov, weights.gamma)
        X = np.array([vector(f(x, row(u, k))) for x in X])
        noise = weights.gamma * np.linalg.cholesky(noise_at(Q, k)).T
        X = np.vstack([X, X[0] + noise, X[0] - noise])
        return belief_of_set(X, weights, X)

    def update(belief: Belief, y_k: Array, k: int) -> Update:
        if belief.points is None:
            X = sigma_points(belief.mean, belief.cov, fresh.gamma)
            X = np.vstack([X, np.tile(X[0], (len(fresh.mean) - len(X), 1))])  # the unused v part leaves x at its mean
        else:
            X = belief.points
        Y = np.array([vector(h(x, row(u, k))) for x in X])
        return update_with_set(belief, X, Y, fresh if belief.points is None else weights, noise_at(R, k), y_k)

    return run(predict, update, m0, P0, y, first)
