"""Functions of Gaussian vectors for the transform experiment, and the true moments of their values."""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class Moments(NamedTuple):
    """Mean and covariance of y = g(x), and its covariance with x."""

    mean: Float[Array, " d"]
    cov: Float[Array, "d d"]
    cross: Float[Array, "n d"]


class Case(NamedTuple):
    """A function and the prior N(mean, factor factorᵀ) that goes through it."""

    g: Callable[[Array], Array]
    mean: Float[np.ndarray, " n"]
    factor: Float[np.ndarray, "n n"]


def _polar(x: Array) -> Array:
    return x[0] * jnp.stack([jnp.cos(x[1]), jnp.sin(x[1])])


def _mixed(x: Array) -> Array:
    return jnp.stack([x[0] ** 2 + x[1] * jnp.exp(x[0] / 2), jnp.sin(x[0] * x[1])])


CASES: dict[str, Case] = {
    "x²": Case(lambda x: x**2, np.array([1.05]), np.array([[0.6]])),
    "sin x": Case(jnp.sin, np.array([1.05]), np.array([[0.6]])),
    "exp x": Case(jnp.exp, np.array([1.05]), np.array([[0.6]])),
    "polar to Cartesian": Case(_polar, np.array([1.0, np.pi / 2]), np.diag([0.02, np.radians(15)])),
    "mixed, correlated": Case(_mixed, np.array([0.5, 0.8]), np.array([[0.4, 0.0], [-0.2, 0.35]])),
}
"""By name; the polar one is Julier & Uhlmann's (1997): 1 m and 90°, known to 2 cm and 15°."""


def truth(case: Case, order: int = 60) -> Moments:
    """Moments by Gauss-Hermite quadrature of high order, for reference."""
    return _weighted(case, *_quadrature(order, len(case.mean)))


@lru_cache
def _quadrature(order: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    nodes, weights = np.polynomial.hermite_e.hermegauss(order)
    grid = np.meshgrid(*[nodes] * n, indexing="ij")
    w = np.prod(np.meshgrid(*[weights / weights.sum()] * n, indexing="ij"), axis=0)
    return np.stack([axis.ravel() for axis in grid], axis=1), w.ravel()


def monte_carlo(case: Case, draws: int, seed: int) -> Moments:
    """Moments of a sample."""
    xi = np.random.default_rng(seed).standard_normal((draws, len(case.mean)))
    return _weighted(case, xi, np.full(draws, 1 / draws))


def _weighted(case: Case, xi: np.ndarray, w: np.ndarray) -> Moments:
    x = case.mean + xi @ case.factor.T
    y = np.asarray(jax.jit(jax.vmap(case.g))(jnp.asarray(x)))
    centre = np.asarray(jax.jit(case.g)(jnp.asarray(case.mean)))  # small differences from here keep their digits
    shift = w @ (y - centre)
    d = y - centre - shift
    return Moments(jnp.asarray(centre + shift), jnp.asarray((w * d.T) @ d), jnp.asarray((w * (x - case.mean).T) @ d))


def deviation(found: Moments, true: Moments) -> tuple[float, float]:
    """Errors: of the mean in true standard deviations (Mahalanobis), of the covariance relative (Frobenius)."""
    white = np.linalg.solve(np.linalg.cholesky(true.cov), np.asarray(found.mean - true.mean))
    return float(np.linalg.norm(white)), float(np.linalg.norm(found.cov - true.cov) / np.linalg.norm(true.cov))
