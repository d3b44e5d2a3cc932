"""First-order Taylor rule (the extended Kalman filter): ȳ = g(0), Φ = ∂g/∂ξ, no E.

Source: Table 7.2.1 of Wan & van der Merwe, "The Unscented Kalman Filter" (2001). With `g(ξ) = f(m + L ξ)` the slope is
`Φ = J L`, by n Jacobian-vector products along the columns of `L`.
"""

from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint.rules.linearization import Linearization, magnitude
from sigmapoint.spaces import Space


@dataclass(frozen=True)
class Taylor:
    """Linearise by the derivative at the mean."""

    def __call__(self, g: Callable[[Array], Array], factor: Float[Array, "n N"], space: Space) -> Linearization:
        origin = jnp.zeros(factor.shape[0], factor.dtype)
        value, along = jax.linearize(g, origin)
        moved = jax.linearize(lambda v: space.residual(v, value), value)[1]
        slope = jax.vmap(lambda column: moved(along(column)), 1, 1)(factor)
        scale = magnitude(value[None], slope.shape[0]) + jnp.sum(jnp.abs(slope), axis=1)
        return Linearization(value, slope, slope[:, :0], scale, slope[:, :0])

    def about(
        self,
        g: Callable[[Array], Array],
        mean: Float[Array, " n"],
        factor: Float[Array, "n n"],
        space: Space,
    ) -> Linearization:
        del factor  # a derivative at a point does not depend on the spread
        return self(lambda step: g(mean + step), jnp.eye(mean.shape[0], dtype=mean.dtype), space)
