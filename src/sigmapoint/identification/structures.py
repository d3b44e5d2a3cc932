"""What a covariance that is learned may look like."""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

Structure = Callable[[Float[Array, "n n"]], Float[Array, "n n"]]
"""A covariance from the second moment found for it."""


def full(moment: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """A covariance without a structure, for `em`."""
    return moment


def diagonal(moment: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """A covariance without correlations, for `em`."""
    return jnp.diag(jnp.diagonal(moment))


def tied(moment: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """One variance for all elements, for `em`."""
    return jnp.mean(jnp.diagonal(moment)) * jnp.eye(moment.shape[0], dtype=moment.dtype)
