"""Checks of a series: measurements, inputs and true states that fit each other and the model."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from sigmapoint import checks


def series(y: Any, u: Any, dtype: Any) -> tuple[Array, Any]:
    """Measurements (T, m) and inputs with the same leading axis, in the dtype of the state."""
    y = checks.array("y", y).astype(dtype)
    if y.ndim != 2:
        hint = "; for a scalar series pass y[:, None]" if y.ndim == 1 else ""
        raise ValueError(f"y must be (T, m), one row a sample, got shape {y.shape}{hint}")
    if y.shape[0] == 0:
        raise ValueError("y has no rows: at least one sample is needed")
    if y.shape[1] == 0:
        raise ValueError("y has no columns: at least one measured quantity is needed")
    measured(y)
    return y, inputs(u, y.shape[0], dtype)


def measured(y: Any) -> None:
    """NaN means not measured; infinity is refused."""
    if checks.known(y) and np.isinf(np.asarray(y)).any():
        raise ValueError("y has infinite values; mark what was not measured with NaN")


def truth(given: Any, shape: tuple[int, ...]) -> np.ndarray:
    """True states, NaN where they are not known."""
    made = np.asarray(checks.array("truth", given))
    if made.shape != shape:
        raise ValueError(
            f"truth must have the shape of the estimates, {shape}, one row a sample and one column a state, "
            f"got {made.shape}"
        )
    return made


def long_enough(T: int, **noises: Any) -> None:
    """A time-varying noise has at least T rows, or the last one holds."""
    for name, noise in noises.items():
        for part, ndim in ((noise.cov, 3), (noise.mean, 2)):
            if part.ndim == ndim and part.shape[0] < T and not noise.lasting:
                raise ValueError(f"{name} is given for {part.shape[0]} instants, but y has {T} rows")


INPUTS_KNOWN = "Inputs must be known: interpolate them, or hold the last value"


def inputs(u: Any, T: int | None, dtype: Any, called: str = "u", rows_of: str = "y", hint: str = INPUTS_KNOWN) -> Any:
    """Every leaf an array with leading axis T (any shape where T is None), floating ones in `dtype` and without NaN."""
    if hasattr(u, "columns") and hasattr(u, "to_numpy"):
        raise ValueError(
            f"{called} is a table: pass {{name: {called}[name].to_numpy() for name in {called}.columns}}, or "
            f"{called}.to_numpy()"
        )

    def leaf(path: Any, value: Any) -> Array | np.ndarray:
        name = called + jax.tree_util.keystr(path)
        checks.unmasked(name, value)
        try:
            # One input of a live filter stays with NumPy: JAX would take longer for it than for the step.
            here = np.asarray(value) if T is None and not isinstance(value, jax.Array) else None
            made = jnp.asarray(value) if here is None or here.dtype.kind not in "fiub" else here
        except TypeError as error:
            kind = getattr(value, "dtype", None)
            got = type(value).__name__ if kind is None else f"an array of {kind}"
            raise ValueError(f"{name} must be an array of numbers, got {got}") from error
        if T is not None and (made.ndim == 0 or made.shape[0] != T):
            raise ValueError(f"{name} must have one row for each of the {T} rows of {rows_of}, got shape {made.shape}")
        if jnp.issubdtype(made.dtype, jnp.floating):
            checks.finite(name, made, hint)
            made = made.astype(dtype)
        return made

    return jax.tree_util.tree_map_with_path(leaf, u)
