"""The central difference transform and Kalman filter (CDKF), additive noise, dense matrices.

Sources: M. Norgaard, N. K. Poulsen, O. Ravn, Automatica 36, 2000; R. van der Merwe and E. A. Wan, "Efficient
Derivative-Free Kalman Filters for Online Learning", 2001, eqs. 10, 14 and the weights under Algorithm 3.1.

The "CDKF" weights in the table of the lecture notes, sec. 6.4 (W0 = (h^2 - L)/h^2 for the covariance too), give another
covariance: the unscented transform with alpha = 1, beta = 0, kappa = h^2 - L, which can be indefinite for L > h^2.
"""

from functools import partial
from typing import Any

import numpy as np

from .gaussian import Array, FilterResult, First, Function, Moments, additive_filter, vector


def central_difference_transform(g: Function, m: Array, P: Array, h: float = 3.0**0.5) -> Moments:
    """Mean and covariance of g(x), and its covariance with x, from first and second central differences of step h."""
    L = m.size
    S = np.linalg.cholesky(P)
    center = vector(g(m))
    plus = np.array([vector(g(m + h * S[:, i])) for i in range(L)])
    minus = np.array([vector(g(m - h * S[:, i])) for i in range(L)])
    mean = (h**2 - L) / h**2 * center + (plus + minus).sum(axis=0) / (2.0 * h**2)
    first, second = plus - minus, plus + minus - 2.0 * center
    cov = first.T @ first / (4.0 * h**2) + (h**2 - 1.0) / (4.0 * h**4) * second.T @ second
    return Moments(mean, cov, S @ first / (2.0 * h))


def cdkf(
    f: Function,
    h: Function,
    Q: Array,
    R: Array,
    m0: Array,
    P0: Array,
    y: Array,
    u: Any = None,
    step: float = 3.0**0.5,
    first: First = "update",
) -> FilterResult:
    """The CDKF with points redrawn before h; `step` is the papers' h."""
    return additive_filter(partial(central_difference_transform, h=step), f, h, Q, R, m0, P0, y, u, first)
