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

    def __call__(self, g: Callable[[Array], Array], origin: Float[Array, " n"], space: Space) -> Linearization:
        value = g(origin)
        slope = jax.jacfwd(lambda xi: space.residual(g(xi), value))(origin)
        scale = magnitude(value[None], slope.shape[0]) + jnp.sum(jnp.abs(slope), axis=1)
        return Linearization(value, slope, slope[:, :0], scale)

    def about(
        self,
        g: Callable[[Array], Array],
        mean: Float[Array, " n"],
        factor: Float[Array, "n n"],
        space: Space,
    ) -> Linearization:
        del factor  # a derivative at a point does not depend on the spread
        return self(lambda xi: g(mean + xi), jnp.zeros_like(mean), space)
