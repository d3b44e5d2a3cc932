"""What every rule returns, and what every sigma-point rule is made of.

A rule looks at a function `g` of a standard normal vector `ξ` and writes it as

    g(ξ) ≈ ȳ + Φ ξ + E ε,      ε ~ N(0, I) independent of ξ,

so that `P_yy = Φ Φᵀ + E Eᵀ`, and the cross-covariance with `x = m + L ξ` is `P_xy = L Φᵀ`.

For a sigma-point rule all three are *fixed linear maps of the function values at fixed points*: `point_sets`.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint.compiled.native import materialized
from sigmapoint.linear_algebra.factors import solve_upper
from sigmapoint.rules.point_sets import PointSet
from sigmapoint.spaces import Space


class Linearization(NamedTuple):
    """`g(ξ) ≈ mean + slope ξ + residual ε` (in the output's space: `mean` is a point, the rest are differences)."""

    mean: Float[Array, " d"]
    slope: Float[Array, "c n"]
    residual: Float[Array, "c k"]
    scale: Float[Array, " c"]
    """size of the numbers it was computed from: what is below their round-off is not there"""
    large: Float[Array, "c k"]
    """numbers so large that in their sum with `residual` there are no digits for its round-off"""

    @property
    def bend(self) -> Float[Array, "c k"]:
        """`residual` without what is mere round-off of the numbers that it was computed from.

        A second difference of a function that is straight is not zero but some round-off of its values. Beside a small
        variance that would count as noise: in 32 bits, values of 1e4 would add a standard deviation of 1e-3. (Where
        covariances are added up, as in the dense form, their own round-off is larger.)
        """
        return (self.residual + self.large) - self.large


@runtime_checkable
class Rule(Protocol):
    """How a function of a Gaussian vector is linearised."""

    def __call__(self, g: Callable[[Array], Array], factor: Float[Array, "n N"], space: Space) -> Linearization:
        """Linearise `g(factor ξ)` in ξ ~ N(0, I); `space` is that of g's values."""
        ...

    def about(
        self,
        g: Callable[[Array], Array],
        mean: Float[Array, " n"],
        factor: Float[Array, "n n"],
        space: Space,
    ) -> Linearization:
        """Linearise `g` about N(mean, factor factorᵀ), with the slope in g's own argument."""
        ...


@dataclass(frozen=True)
class SigmaPointRule(ABC):
    """A rule from function values alone. A subclass says which constants, in `sigma_points`."""

    @abstractmethod
    def sigma_points(self, n: int) -> PointSet:
        """The constants in `n` dimensions; ValueError where the parameters do not work."""

    def __call__(self, g: Callable[[Array], Array], factor: Float[Array, "n N"], space: Space) -> Linearization:
        N = factor.shape[1]
        return self.combine(self.constants(N).values(g, factor), N, space)

    def about(
        self,
        g: Callable[[Array], Array],
        mean: Float[Array, " n"],
        factor: Float[Array, "n n"],
        space: Space,
    ) -> Linearization:
        # No narrower than differences can resolve: a direction known exactly would otherwise leave no slope to see.
        narrow = jnp.finfo(factor.dtype).eps ** (1 / 3) - jnp.diagonal(factor)
        factor = factor + jnp.diag(jnp.maximum(narrow, 0.0))
        lin = self(lambda step: g(mean + step), factor, space)
        slope = solve_upper(factor, lin.slope.T).T
        return lin._replace(slope=slope, scale=lin.scale / jnp.min(jnp.diagonal(factor)))

    def combine(self, values: Float[Array, "p d"], n: int, space: Space) -> Linearization:
        """The linearisation from the function values at the points of dimension `n`."""
        constants = self.constants(n)
        D = jax.vmap(space.residual, (0, None))(values[1:], values[0])
        shift, slope, residual = constants.projected(materialized(D))
        scale = jax.lax.stop_gradient(magnitude(values, slope.shape[1], n))
        return Linearization(space.retract(values[0], shift), slope.T, residual.T, scale, constants.large(scale).T)

    def constants(self, n: int) -> PointSet:
        """`sigma_points(n)`, remembered."""
        return _remembered(self, n)


@lru_cache(maxsize=512)
def _remembered(rule: SigmaPointRule, n: int) -> PointSet:
    return rule.sigma_points(n)


def magnitude(values: Float[Array, "p d"], size: int, n: int = 0) -> Float[Array, " c"]:
    """How large values are, in each element: 1 to √(2n+1) times the largest at a symmetric set in n dimensions.

    That of all elements together where a difference (of `size`) has other elements than a value.
    """
    squares = (2 * n + 1) / values.shape[0] * jnp.sum(values**2, axis=0)
    squares = squares if squares.shape[0] == size else jnp.full(size, jnp.sum(squares))
    return jnp.sqrt(jnp.minimum(squares, jnp.finfo(values.dtype).max))
