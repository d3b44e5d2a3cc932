"""MacKay's robot arm: from the angles of two joints to the place of the hand.

    y₁ = 2.0 cos x₁ + 1.3 cos(x₁ + x₂) + v₁,    y₂ = 2.0 sin x₁ + 1.3 sin(x₁ + x₂) + v₂,    v ~ N(0, 0.05²)

with x₁ uniform over ±[0.453, 1.932] and x₂ over [0.534, 3.142]. Source: D. J. C. MacKay, "A Practical Bayesian
Framework for Backpropagation Networks", Neural Computation 4 (1992). His own 600 rows are not passed on here; others
are drawn from the same formula.
"""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

NOISE = 0.05
"""standard deviation of each target, in units of length"""
FIRST, SECOND = (0.453, 1.932), (0.534, 3.142)
"""[rad] ranges of the angles; the first with either sign"""
LINKS = (2.0, 1.3)
"""lengths of the two links"""


def hand(x: Float[Array, "N 2"]) -> Float[Array, "N 2"]:
    """Where the hand is [length] at these angles [rad]."""
    angle = jnp.stack([x[:, 0], x[:, 0] + x[:, 1]])
    lengths = jnp.array(LINKS)
    return jnp.stack([lengths @ jnp.cos(angle), lengths @ jnp.sin(angle)], axis=1)


def drawn(rows: int, key: Array) -> tuple[Float[Array, "N 2"], Float[Array, "N 2"]]:
    """Angles [rad] and noisy places of the hand [length]."""
    keys = jax.random.split(key, 4)
    first = jax.random.uniform(keys[0], (rows,), minval=FIRST[0], maxval=FIRST[1])
    sign = jax.random.rademacher(keys[1], (rows,), first.dtype)
    second = jax.random.uniform(keys[2], (rows,), minval=SECOND[0], maxval=SECOND[1])
    x = jnp.stack([sign * first, second], axis=1)
    return x, hand(x) + NOISE * jax.random.normal(keys[3], (rows, 2))


def mackays(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """His own 600 rows from a folder that has them, angles and places; the first 200 are for training."""
    return np.loadtxt(folder / "Mackay-inputs.data"), np.loadtxt(folder / "Mackay-outputs.data")
