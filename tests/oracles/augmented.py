"""Non-additive noise with any transform: one transform of (x, v, n) gives the joint moments of the next x and its y.

Source: the augmented recursion of Table 7.3.1 of the UKF chapter, eqs. 7.37-7.49, with its weighted sums replaced by a
transform of the stacked map (x, v, n) -> (f(x, u, v), h(f(x, u, v), u', n)); with the unscented one it is that table.
"""

from typing import Any

import numpy as np

from .gaussian import (
    Array,
    Belief,
    FilterResult,
    First,
    Function,
    Transform,
    Update,
    condition,
    noise_at,
    row,
    run,
    vector,
)
from .unscented import block_diagonal


def augmented_filter(
    transform: Transform,
    f: Function,
    h: Function,
    Q: Array,
    R: Array,
    m0: Array,
    P0: Array,
    y: Array,
    u: Any = None,
    first: First = "predict",
) -> FilterResult:
    """x[k+1] = f(x, u, v), y[k] = h(x, u, n); an update before any prediction uses (x, v, n) -> (x, h(x, u, n))."""
    n, q = len(m0), noise_at(Q, 0).shape[0]

    def joint(belief: Belief, k_f: int, k_h: int, move: Function) -> tuple[Array, Array]:
        def stacked(z: Array) -> Array:
            x = vector(move(z[:n], z[n : n + q]))
            return np.concatenate([x, vector(h(x, row(u, k_h), z[n + q :]))])

        Q_k, R_k = noise_at(Q, k_f), noise_at(R, k_h)
        mean = np.concatenate([belief.mean, np.zeros(len(Q_k) + len(R_k))])
        moments = transform(stacked, mean, block_diagonal(belief.cov, Q_k, R_k))
        return moments.mean, moments.cov

    def predict(belief: Belief, k: int) -> Belief:
        mean, cov = joint(belief, k, k + 1, lambda x, v: f(x, row(u, k), v))
        return Belief(mean[:n], cov[:n, :n], (mean, cov))

    def update(belief: Belief, y_k: Array, k: int) -> Update:
        mean, cov = belief.points or joint(belief, k, k, lambda x, _: x)
        return condition(belief.mean, belief.cov, mean[n:], cov[n:, n:], cov[:n, n:], y_k)

    return run(predict, update, m0, P0, y, first)
