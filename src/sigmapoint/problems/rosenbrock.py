"""Rosenbrock's curved valley as a sum of two squares, f = |e|², with its least value 0 at (1, 1).

    e = (10 (x₂ − x₁²), 1 − x₁)

Source: H. H. Rosenbrock, "An Automatic Method for Finding the Greatest or Least Value of a Function", Computer Journal
3 (1960). Wan & van der Merwe, "The Unscented Kalman Filter" (2001), print e below eq. 7.96 without the square of x₁;
their f, eq. 7.94, has it.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

START = (-1.2, 1.0)
"""Rosenbrock's own."""


def residual(x: Float[Array, "*many 2"]) -> Float[Array, "*many 2"]:
    """e, which is zero at the minimum."""
    return jnp.stack([10 * (x[..., 1] - x[..., 0] ** 2), 1 - x[..., 0]], axis=-1)


def cost(x: Float[Array, "*many 2"]) -> Float[Array, "*many"]:
    """f = |e|².

    Examples:
        >>> import jax.numpy as jnp
        >>> from sigmapoint.problems import rosenbrock
        >>> round(float(rosenbrock.cost(jnp.array(rosenbrock.START))), 4)
        24.2
    """
    return jnp.sum(residual(x) ** 2, axis=-1)
