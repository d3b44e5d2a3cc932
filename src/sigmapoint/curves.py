"""Curves of angles: between plus and minus half a turn, and without a line across the figure where they wrap."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from sigmapoint.spaces import Space, same_elements


def principal(space: Space, points: Float[np.ndarray, "T d"]) -> Float[np.ndarray, "T d"]:
    """Angles within half a turn of zero, as estimates of them are; everything else as it is."""
    if not same_elements(space):
        return points
    return np.asarray(jax.vmap(space.retract)(jnp.asarray(points), jnp.zeros_like(points)))


def wraps(space: Space, points: Float[np.ndarray, "T d"], i: int) -> Int[np.ndarray, "B"]:
    """Rows whose element `i` is reached from the row before by the other way round than a straight line takes."""
    if not same_elements(space):
        return np.zeros(0, int)
    at = jnp.asarray(points)
    short, plain = jax.vmap(space.residual)(at[1:], at[:-1])[:, i], (at[1:] - at[:-1])[:, i]
    return 1 + np.flatnonzero(np.isfinite(plain) & ~np.isclose(short, plain, rtol=1e-3, atol=0.0))


def broken(breaks: Int[np.ndarray, "B"], x: np.ndarray, *curves: Float[np.ndarray, "T"]) -> tuple[np.ndarray, ...]:
    """Instants and curves with NaN put in before the rows `breaks`: no line is drawn to those."""
    return np.insert(x, breaks, x[breaks]), *(np.insert(curve, breaks, np.nan) for curve in curves)
