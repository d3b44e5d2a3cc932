"""A series as pairs for learning: its next sample from those before, newest first as in a state vector."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def normalized(series: Float[Array, " T"]) -> Float[Array, " T"]:
    """With mean 0 and standard deviation 1."""
    return (series - series.mean()) / series.std()


def pairs(series: Float[Array, " T"], order: int) -> tuple[Float[Array, "N order"], Float[Array, "N 1"]]:
    """Inputs (x[k−1], …, x[k−order]) and targets x[k], one pair for each k ≥ order."""
    T = series.shape[0]
    past = [series[order - lag : T - lag] for lag in range(1, order + 1)]
    return jnp.stack(past, axis=1), series[order:, None]
