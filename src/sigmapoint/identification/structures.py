"""What a covariance that is learned may look like."""

from collections.abc import Callable
from typing import Any

import jax
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


def check_structure(name: str, structure: Any, cov: Float[Array, "*T n n"]) -> None:
    """A function from a second moment to a covariance, which JAX can trace.

    Raises:
        ValueError: something else.
    """
    given = getattr(structure, "__name__", repr(structure))
    moment = jax.ShapeDtypeStruct(cov.shape[-2:], cov.dtype)
    expected = (
        f"em: {name} must be sp.full, sp.diagonal, sp.tied, None (it stays as it is) or a function in jax.numpy from a "
        f"second moment {moment.shape} to a covariance {moment.shape}, got {given}"
    )
    if not callable(structure):
        raise ValueError(expected)
    try:
        made = jax.eval_shape(structure, moment)
    except Exception as error:
        raise ValueError(f"{expected}, which raises {type(error).__name__}") from error
    if getattr(made, "shape", None) != moment.shape or not jnp.issubdtype(made.dtype, jnp.floating):
        raise ValueError(f"{expected}, which gives {made}")
