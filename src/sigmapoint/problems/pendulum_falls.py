"""Falls of the double inverted pendulum from random starts, until a rod has passed the horizontal."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from sigmapoint.problems import pendulum

ANGLE, RATE = 0.44, 0.5
"""[rad] both angles start within ± this (25°); [m/s, rad/s] standard deviation of all rates"""
LONGEST = 75
"""[steps] falls take about thirty"""


class Falls(NamedTuple):
    """States with the force behind them, the states a step later, and whether the fall was still going on."""

    before: Float[Array, "N T 7"]
    """[m, m/s, rad, rad/s, rad, rad/s, N]"""
    after: Float[Array, "N T 6"]
    there: Bool[Array, "N T"]


def drawn(falls: int, force: float, disturbance: float, key: Array) -> Falls:
    """Falls of the true pendulum, the cart in the middle at first.

    Args:
        falls: number of them.
        force: [N] standard deviation of the force on the cart, which is constant during a fall.
        disturbance: standard deviation of what is added to each state at each step, in the units of the states.
        key: of `jax.random`.
    """
    keys = jax.random.split(key, 4)
    angles = jax.random.uniform(keys[0], (falls, 2), minval=-ANGLE, maxval=ANGLE)
    rates = RATE * jax.random.normal(keys[1], (falls, 3))
    starts = jnp.stack([jnp.pad(angles, ((0, 0), (1, 0))), rates], axis=2).reshape(falls, 6)
    forces = jnp.tile(force * jax.random.normal(keys[2], (falls, 1)), LONGEST)
    added = disturbance * jax.random.normal(keys[3], (falls, LONGEST, 6))
    x = _fallen(starts, forces, added)
    there = jnp.cumsum(pendulum.fallen(x), axis=1)[:, :-1] == 0
    return Falls(jnp.concatenate([x[:, :-1], forces[:, :, None]], axis=2), x[:, 1:], there)


@jax.jit
def _fallen(starts: Float[Array, "N 6"], forces: Float[Array, "N T"], added: Float[Array, "N T 6"]) -> Array:
    return jax.vmap(pendulum.fall, (None, 0, 0, 0))(pendulum.TRUTH, starts, forces, added)
