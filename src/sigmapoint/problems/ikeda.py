"""The Ikeda map: light that goes round a ring cavity with a nonlinear medium, chaotic.

    t = 0.4 − 6 / (1 + x² + y²),    x⁺ = 1 + u (x cos t − y sin t),    y⁺ = u (x sin t + y cos t),    u = 0.9

Each step turns and shrinks the plane, areas by u² everywhere, and stretches it by turning the inside further. Source:
K. Ikeda, "Multiple-valued stationary state and its instability of the transmitted light by a ring cavity system",
Optics Communications 30 (1979); the real form is that of S. M. Hammel, C. K. R. T. Jones, J. V. Moloney, J. Opt. Soc.
Am. B 2 (1985).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

U = 0.9
TRANSIENT = 100
"""steps until a point is on the attractor, to all digits that matter"""


def step(point: Float[Array, " 2"]) -> Float[Array, " 2"]:
    """The map."""
    x, y = point
    t = 0.4 - 6 / (1 + x**2 + y**2)
    return jnp.stack([1 + U * (x * jnp.cos(t) - y * jnp.sin(t)), U * (x * jnp.sin(t) + y * jnp.cos(t))])


def drawn(samples: int, key: Array) -> Float[Array, "T 2"]:
    """An orbit on the attractor, from somewhere in the unit square."""
    start = jax.random.uniform(key, (2,))

    def one(point: Array, _: None) -> tuple[Array, Array]:
        after = step(point)
        return after, after

    return jax.lax.scan(one, start, None, TRANSIENT + samples)[1][TRANSIENT:]
