"""Four interlocking regions of the square [−1, 1]², to be told apart from a point of it.

With r the distance from the origin: beyond 5/6 the upper half is region 0 and the lower half region 1. Within, the
parts 1/6 < r ≤ 1/2 and 1/2 < r ≤ 5/6 are split at x₁ = 0 into regions 2 and 3, the inner one the other way round than
the outer one; the disc r ≤ 1/6 is of region 2. Source: S. Singhal & L. Wu, "Training Multilayer Perceptrons with the
Extended Kalman Algorithm", Advances in Neural Information Processing Systems 1 (1989).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

REGIONS = 4
RADII = (1 / 6, 1 / 2, 5 / 6)
TARGET = 0.8
"""the target of the region a point is in; of the others its negative"""


def region(x: Float[Array, "N 2"]) -> Int[Array, " N"]:
    """Which region points are in."""
    r = jnp.linalg.norm(x, axis=1)
    disc, inner, outer = RADII
    within = jnp.where((r <= disc) | ((x[:, 0] > 0) == (r > inner)), 2, 3)
    return jnp.where(r > outer, jnp.where(x[:, 1] > 0, 0, 1), within)


def targets(labels: Int[Array, " N"]) -> Float[Array, "N 4"]:
    """What a network is to give, one output a region."""
    return jnp.where(labels[:, None] == jnp.arange(REGIONS)[None], TARGET, -TARGET)


def drawn(points: int, key: Array) -> tuple[Float[Array, "N 2"], Int[Array, " N"]]:
    """Points drawn uniformly, and their regions."""
    x = jax.random.uniform(key, (points, 2), minval=-1, maxval=1)
    return x, region(x)


def grid(side: int) -> tuple[Float[Array, "N 2"], Int[Array, " N"]]:
    """The centres of side × side equal cells, row by row from below, and their regions."""
    centres = (2 * jnp.arange(side) + 1) / side - 1
    x = jnp.stack(jnp.meshgrid(centres, centres), axis=-1).reshape(-1, 2)
    return x, region(x)
