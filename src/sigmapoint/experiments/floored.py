"""Gaussian noise with a floor under its density, as in the particle filters of the authors' programs (2000).

Weights are no logarithms there: 1e-99 is added to every density. Where all particles are further off than that, all are
alike, and the proposal decides alone.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import sigmapoint as sp

LEAST = 1e-99
"""added to every density"""


class Floored(eqx.Module):
    """A Gaussian of mean zero and independent elements, `least` added to its density."""

    variance: Float[Array, " q"]
    least: Float[Array, ""]

    batch_shape = ()

    @property
    def event_shape(self) -> tuple[int, ...]:
        return self.variance.shape

    @property
    def mean(self) -> Float[Array, " q"]:
        return jnp.zeros_like(self.variance)

    def sample(self, key: Array, sample_shape: tuple[int, ...] = ()) -> Float[Array, "*N q"]:
        shape = (*sample_shape, *self.variance.shape)
        return jnp.broadcast_to(jnp.sqrt(self.variance), shape) * jax.random.normal(key, shape)

    def log_prob(self, value: Float[Array, "*N q"]) -> Float[Array, "*N"]:
        squares = jnp.sum(value**2 / jnp.broadcast_to(self.variance, value.shape), axis=-1)
        constant = jnp.sum(jnp.log(2 * jnp.pi * self.variance))
        return jnp.logaddexp(-0.5 * (squares + constant), jnp.log(self.least))


def floored(noise: sp.Additive | sp.NonAdditive, least: float = LEAST) -> sp.Additive:
    """The same noise of independent elements, with `least` added to its density."""
    return sp.Additive(noise.cov, distribution=Floored(jnp.diagonal(noise.cov), jnp.asarray(least, noise.cov.dtype)))


def height(noise: sp.Additive | sp.NonAdditive) -> float:
    """Density of a noise at its mean."""
    return float(np.prod(2 * np.pi * np.diagonal(np.asarray(noise.cov))) ** -0.5)
