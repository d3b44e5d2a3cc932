"""Gauss-Hermite quadrature under a Gaussian: moments in one dimension, and the tensor-product transform and filter.

Source: K. Ito and K. Xiong, "Gaussian Filters for Nonlinear Filtering Problems", IEEE Trans. Autom. Control 45, 2000.
The weight is that of N(0, 1), exp(-x^2/2)/sqrt(2 pi) (the UKF chapter's footnote 5 prints exp(-x^2), a slip); a rule of
order p is exact for polynomials of degree 2p - 1.
"""

from collections.abc import Callable
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from numpy.polynomial.hermite_e import hermegauss

from .gaussian import Array, FilterResult, First, Function, Moments, additive_filter, vector


def unit_rule(order: int) -> tuple[Array, Array]:
    """Points and weights for x ~ N(0, 1); the weights sum to one."""
    points, weights = hermegauss(order)
    return points, weights / np.sqrt(2.0 * np.pi)


def gauss_hermite_moments(
    g: Callable[[Array], Array], mean: float, variance: float, order: int
) -> tuple[float, float, float]:
    """E g(x), Var g(x) and Cov(x, g(x)) for scalar x ~ N(mean, variance) and an elementwise g."""
    points, weights = unit_rule(order)
    x = mean + np.sqrt(variance) * points
    y = np.asarray(g(x))
    y_mean = float(weights @ y)
    return y_mean, float(weights @ (y - y_mean) ** 2), float(weights @ ((x - mean) * (y - y_mean)))


def gauss_hermite_transform(g: Function, m: Array, P: Array, order: int = 3) -> Moments:
    """Mean and covariance of g(x), and its covariance with x, from the order^n points of the tensor product."""
    points, weights = unit_rule(order)
    unit = np.array(list(product(points, repeat=m.size)))
    W = np.array([np.prod(w) for w in product(weights, repeat=m.size)])
    X = m + unit @ np.linalg.cholesky(P).T
    Y = np.array([vector(g(point)) for point in X])
    mean = W @ Y
    weighted = W[:, None] * (Y - mean)
    return Moments(mean, (Y - mean).T @ weighted, (X - m).T @ weighted)


def ghkf(
    f: Function,
    h: Function,
    Q: Array,
    R: Array,
    m0: Array,
    P0: Array,
    y: Array,
    u: Any = None,
    order: int = 3,
    first: First = "update",
) -> FilterResult:
    """The Gauss-Hermite Kalman filter."""
    return additive_filter(partial(gauss_hermite_transform, order=order), f, h, Q, R, m0, P0, y, u, first)
