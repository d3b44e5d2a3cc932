"""Several series of different lengths, checked against each other and the model."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sigmapoint import checks
from sigmapoint.checks import data_checks
from sigmapoint.filtering import series_of
from sigmapoint.model import StateSpaceModel


class Ragged(NamedTuple):
    """Series of different lengths, one behind the other."""

    y: Any
    u: Any
    starts: np.ndarray
    lengths: np.ndarray

    def held(self, members: np.ndarray, T: int) -> Int[np.ndarray, "S T"]:
        """Rows of these series; of one shorter than T, the last again and again."""
        return np.minimum(np.arange(T), self.lengths[members][:, None] - 1) + self.starts[members][:, None]


def stacked(model: StateSpaceModel, y: Any, u: Any) -> tuple[Float[Array, "S T m"], Any, Int[np.ndarray, " S"]]:
    """One series (T, m) or a list of them, checked: measurements and inputs with axes (S, T), and the lengths.

    Past the end of a series its measurements are NaN, and its inputs the last.
    """
    if isinstance(y, list | tuple):
        rows = concatenated(y, u)
    else:
        y, u = series_of(model, y, u)
        rows = Ragged(y, u, np.zeros(1, int), np.array([y.shape[0]]))
    T = int(rows.lengths.max())
    flat_y, flat_u = series_of(model, rows.y, rows.u, T)
    held = rows.held(np.arange(len(rows.lengths)), T)
    there = np.arange(T) < rows.lengths[:, None]
    filled = jnp.where(there[..., None], flat_y[held], jnp.nan).astype(flat_y.dtype)
    return filled, jax.tree.map(lambda a: a[held], flat_u), rows.lengths


def concatenated(ys: Sequence[Any], us: Any) -> Ragged:
    """Several series as one, checked against each other.

    Raises:
        ValueError: none, or some that differ in more than their lengths; as many `u` as `y`.
    """
    if not ys:
        raise ValueError("y is an empty list: at least one series is needed")
    for i, y in enumerate(ys):
        checks.unmasked(f"y[{i}]", y)
    made = [np.asarray(y) for y in ys]
    for i, y in enumerate(made):
        if y.ndim != 2 or not y.shape[0] or y.shape[1] != made[0].shape[-1]:
            raise ValueError(
                f"y[{i}] must be (T, m) with T >= 1 and the same m in every series, got shape {y.shape}"
                + ("" if i == 0 else f" after {made[0].shape}")
            )
    lengths = np.array([len(y) for y in made])
    if us is not None:
        if not isinstance(us, list | tuple) or len(us) != len(made):
            raise ValueError(f"u must be a list of {len(made)} pytrees, one for each series of y")
        structures = {jax.tree.structure(u) for u in us}
        if len(structures) > 1:
            raise ValueError("u must have the same structure for every series")
        for i, u in enumerate(us):
            try:
                data_checks.inputs(u, int(lengths[i]), np.float64)
            except ValueError as error:
                raise ValueError(f"series {i}: {error}") from None
        us = jax.tree.map(lambda *leaves: np.concatenate([np.asarray(a) for a in leaves]), *us)
    return Ragged(np.concatenate(made), us, np.cumsum(lengths) - lengths, lengths)
