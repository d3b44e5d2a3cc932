"""The third-degree spherical-radial cubature rule: 2n points m +- sqrt(n) sqrt(P)_i of equal weight 1/(2n).

Source: I. Arasaratnam and S. Haykin, "Cubature Kalman Filters", IEEE Trans. Automatic Control 54, 2009.
"""

from typing import Any

import numpy as np

from .gaussian import Array, FilterResult, First, Function, Moments, additive_filter, vector


def cubature_transform(g: Function, m: Array, P: Array) -> Moments:
    """Mean and covariance of g(x), and its covariance with x, for x ~ N(m, P)."""
    n = m.size
    spread = np.sqrt(n) * np.linalg.cholesky(P).T
    X = np.vstack([m + spread, m - spread])
    Y = np.array([vector(g(point)) for point in X])
    mean = Y.mean(axis=0)
    return Moments(mean, (Y - mean).T @ (Y - mean) / (2 * n), (X - m).T @ (Y - mean) / (2 * n))


def ckf(
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
    """The cubature Kalman filter."""
    return additive_filter(cubature_transform, f, h, Q, R, m0, P0, y, u, first)
