"""The iterated posterior linearisation filter (IPLF): h is regressed on x under the current posterior, not the prior.

Source: A. F. Garcia-Fernandez, L. Svensson, M. R. Morelande, S. Sarkka, "Posterior Linearization Filter: Principles and
Implementation Using Sigma Points", IEEE Trans. Signal Processing 63, 2015.
"""

from typing import Any

import numpy as np

from .cubature import cubature_transform
from .gaussian import (
    Array,
    Belief,
    FilterResult,
    First,
    Function,
    Transform,
    Update,
    noise_at,
    predicted,
    row,
    run,
    symmetric,
)
from .kalman import kalman_update


def statistical_linear_regression(
    g: Function, m: Array, P: Array, transform: Transform = cubature_transform
) -> tuple[Array, Array, Array]:
    """A, b, Omega of the best fit g(x) = A x + b + e, e ~ N(0, Omega), in the mean square under x ~ N(m, P)."""
    moments = transform(g, m, P)
    A = np.linalg.solve(P, moments.cross).T
    return A, moments.mean - A @ m, symmetric(moments.cov - A @ P @ A.T)


def posterior_linearization_update(
    h: Function,
    R: Array,
    m: Array,
    P: Array,
    y: Array,
    iterations: int = 1,
    transform: Transform = cubature_transform,
) -> Update:
    """Regress h under the iterate, update the prior (m, P), repeat; one iteration is the filter of `transform`.

    The innovation, its covariance and the log density are those of the last regression, under the prior (m, P).
    """
    at = Belief(m, P)
    for _ in range(iterations):
        A, b, Omega = statistical_linear_regression(h, at.mean, at.cov, transform)
        update = kalman_update(m, P, A, b, Omega + R, y)
        at = Belief(update.mean, update.cov)
    return update


def iplf(
    f: Function,
    h: Function,
    Q: Array,
    R: Array,
    m0: Array,
    P0: Array,
    y: Array,
    u: Any = None,
    iterations: int = 3,
    transform: Transform = cubature_transform,
    first: First = "update",
) -> FilterResult:
    """Predictions by `transform`, updates by posterior linearisation."""

    def predict(belief: Belief, k: int) -> Belief:
        return predicted(transform(lambda x: f(x, row(u, k)), belief.mean, belief.cov), noise_at(Q, k))

    def update(belief: Belief, y_k: Array, k: int) -> Update:
        u_k = row(u, k)
        return posterior_linearization_update(
            lambda x: h(x, u_k), noise_at(R, k), belief.mean, belief.cov, y_k, iterations, transform
        )

    return run(predict, update, m0, P0, y, first)
