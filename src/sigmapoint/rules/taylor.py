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

FEWER = 8
"""Derivatives are taken backward where the elements of a value are so many times fewer than the columns."""


@dataclass(frozen=True)
class Taylor:
    """Linearise by the derivative at the mean."""

    def __call__(self, g: Callable[[Array], Array], factor: Float[Array, "n N"], space: Space) -> Linearization:
        origin = jnp.zeros(factor.shape[0], factor.dtype)
        if _few(g, origin):
            value, slope = _jacobian(g, origin, space)
            return _linearized(value, slope @ factor)
        value, along = jax.linearize(g, origin)
        moved = jax.linearize(lambda v: space.residual(v, value), value)[1]
        slope = jax.vmap(lambda column: moved(along(column)), 1, 1)(factor)
        return _linearized(value, slope)

    def about(
        self,
        g: Callable[[Array], Array],
        mean: Float[Array, " n"],
        factor: Float[Array, "n n"],
        space: Space,
    ) -> Linearization:
        del factor  # a derivative at a point does not depend on the spread
        moved, origin = (lambda step: g(mean + step)), jnp.zeros_like(mean)
        if _few(moved, origin):
            return _linearized(*_jacobian(moved, origin, space))
        return self(moved, jnp.eye(mean.shape[0], dtype=mean.dtype), space)


def _few(g: Callable[[Array], Array], origin: Float[Array, " n"]) -> bool:
    return FEWER * jax.eval_shape(g, origin).shape[0] < origin.shape[0]


def _jacobian(g: Callable[[Array], Array], origin: Array, space: Space) -> tuple[Array, Array]:
    """Value and derivative, backward: one pass for each element of the value."""
    value, back = jax.vjp(g, origin)
    moved = jax.jacfwd(lambda v: space.residual(v, value))(value)
    return value, jax.vmap(lambda row: back(row)[0])(moved)


def _linearized(value: Array, slope: Array) -> Linearization:
    scale = magnitude(value[None], slope.shape[0]) + jnp.sum(jnp.abs(slope), axis=1)
    return Linearization(value, slope, slope[:, :0], scale, slope[:, :0])
