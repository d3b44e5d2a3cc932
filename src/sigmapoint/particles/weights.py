"""Weights of particles, as logarithms throughout, and moments of what they weigh.

A density may be too small for any number (e⁻⁵⁰⁰⁰⁰ is zero): only differences of logarithms are ever raised to e.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint.belief import symmetric
from sigmapoint.spaces import Space

EXACT = jax.lax.Precision.HIGHEST


class Weighed(NamedTuple):
    """Weights that sum to one, and the logarithm of what they summed to."""

    log_weights: Float[Array, " N"]
    log_total: Float[Array, ""]


def even(count: int, dtype: jnp.dtype) -> Float[Array, " N"]:
    """The same weight for all."""
    return jnp.full(count, -jnp.log(jnp.asarray(count, dtype)), dtype)


def weighed(log_weights: Float[Array, " N"], log_ratio: Float[Array, " N"]) -> Weighed:
    """Weights multiplied by a ratio. Where all become zero, they stay as they were, and the total is minus infinity.

    A ratio that is NaN, as of a particle for which the model has no value, counts as zero.
    """
    largest = jnp.finfo(log_ratio.dtype).max / 4
    log_ratio = jnp.where(jnp.isnan(log_ratio), -jnp.inf, jnp.minimum(log_ratio, largest))
    product = log_weights + log_ratio
    top = jnp.max(product)
    none = top == -jnp.inf
    below = product - jnp.where(none, 0.0, top)  # apart from the total, in whose digits a difference may be lost
    log_sum = jnp.log(jnp.sum(jnp.exp(below)))
    return Weighed(jnp.where(none, log_weights, below - jnp.where(none, 0.0, log_sum)), top + log_sum)


def effective(log_weights: Float[Array, " N"]) -> Float[Array, ""]:
    """Effective sample size, 1 / Σ W² (Kong, Liu & Wong 1994): N where all weigh the same, 1 where one has all."""
    return 1 / jnp.sum(jnp.exp(log_weights) ** 2)


class Cloud(NamedTuple):
    """First and second moments of weighted points."""

    mean: Float[Array, " d"]
    cov: Float[Array, "n n"]
    std: Float[Array, " n"]


def moments(points: Float[Array, "N d"], log_weights: Float[Array, " N"], space: Space) -> Cloud:
    """Mean, covariance and standard deviations of weighted points; in a space with its own differences, about the mean.

    Points of no weight are of no account, whatever they are.
    """
    weights = jnp.exp(log_weights)

    def about(centre: Array) -> tuple[Array, Array]:
        off = jax.vmap(lambda x: space.residual(x, centre))(points)
        off = jnp.where(weights[:, None] > 0, off, 0.0)
        return off, jnp.dot(weights, off, precision=EXACT)

    first = points[jnp.argmax(log_weights)]
    near = space.retract(first, about(first)[1])
    off, shift = about(near)
    spread = off - shift[None]
    cov = symmetric(jnp.dot((weights[:, None] * spread).T, spread, precision=EXACT))
    return Cloud(space.retract(near, shift), cov, jnp.sqrt(jnp.diagonal(cov)))


def together(
    log_weights: Float[Array, " G"], means: Float[Array, "G d"], covs: Float[Array, "G n n"], space: Space
) -> Cloud:
    """Moments of weighted Gaussians: Σ w (C + (m − m̄)(m − m̄)ᵀ)."""
    between = moments(means, log_weights, space)
    cov = symmetric(between.cov + jnp.einsum("g,gij->ij", jnp.exp(log_weights), covs))
    return Cloud(between.mean, cov, jnp.sqrt(jnp.diagonal(cov)))
