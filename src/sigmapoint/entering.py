"""How a noise enters a function, instant by instant.

Additive noise can stay outside the sigma points (`rest`); noise inside a function always needs coordinates `ξ` of its
own. That is decided here, once, by the two kinds; no filter asks which it is.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint.belief import Spread
from sigmapoint.compiled.native import applied
from sigmapoint.densities import Density, Normal, whitening
from sigmapoint.distributions import Given
from sigmapoint.spaces import Space


class Entry(NamedTuple):
    """How a noise enters a function: through `size` coordinates ξ of the points, the `rest` added afterwards."""

    size: int
    call: Callable[[Array, Any, Array], Array]
    rest: Spread | None


@runtime_checkable
class Noise(Protocol):
    """A noise at one instant, as the filters see it."""

    def within(self, f: Callable[..., Any], space: Space) -> Entry:
        """`f` with as little noise in the points as possible."""
        ...

    def through(self, f: Callable[..., Any], space: Space) -> Entry:
        """`f` with all of the noise in the points."""
        ...

    def drawn(self, f: Callable[..., Any], space: Space) -> Callable[[Array, Any, Array], tuple[Array, Array]]:
        """`(x, u, w)` to the value of `f` with the noise `w`, and what `w` was added to (itself where it was not)."""
        ...


class AdditiveNoise(NamedTuple):
    """`f(x, u) + w`, `w ~ N(mean, spread)`."""

    mean: Float[Array, " q"]
    spread: Spread

    def within(self, f: Callable[..., Any], space: Space) -> Entry:
        return Entry(0, lambda x, u, xi: space.retract(f(x, u), self.mean), self.spread)

    def through(self, f: Callable[..., Any], space: Space) -> Entry:
        def call(x: Array, u: Any, xi: Array) -> Array:
            return space.retract(f(x, u), self.mean + applied(self.spread.factor, xi))

        return Entry(self.mean.shape[0], call, None)

    def drawn(self, f: Callable[..., Any], space: Space) -> Callable[[Array, Any, Array], tuple[Array, Array]]:
        def call(x: Array, u: Any, w: Array) -> tuple[Array, Array]:
            centre = f(x, u)
            return space.retract(centre, w), centre

        return call


class StackedNoise(NamedTuple):
    """`f(x, u, w)`, `w ~ N(mean, spread)`."""

    mean: Float[Array, " q"]
    spread: Spread

    def within(self, f: Callable[..., Any], space: Space) -> Entry:
        return self.through(f, space)

    def through(self, f: Callable[..., Any], space: Space) -> Entry:
        return Entry(self.mean.shape[0], lambda x, u, xi: f(x, u, self.mean + applied(self.spread.factor, xi)), None)

    def drawn(self, f: Callable[..., Any], space: Space) -> Callable[[Array, Any, Array], tuple[Array, Array]]:
        def call(x: Array, u: Any, w: Array) -> tuple[Array, Array]:
            value = f(x, u, w)
            moved = space.retract(value, space.residual(value, value))  # nowhere, but into the space
            return moved, moved

        return call


class NoiseSeries(NamedTuple):
    """A noise made ready for a run: factored once, looked up by instant."""

    kind: type
    mean: Float[Array, "*T q"]
    spread: Spread
    whitening: Float[Array, "*T q q"]
    distribution: Any
    """what it is drawn from; a Gaussian where there is none"""

    @classmethod
    def of(cls, noise: Any, dtype: Any) -> "NoiseSeries":
        """From `Additive` or `NonAdditive`."""
        cov = noise.cov.astype(dtype)
        of = jax.vmap(Spread.of) if cov.ndim == 3 else Spread.of
        to_white = jax.vmap(whitening) if cov.ndim == 3 else whitening
        return cls(noise.kind, noise.mean.astype(dtype), of(cov), to_white(cov), noise.distribution)

    def at(self, k: Array) -> Noise:
        """The noise at instant `k`; past the end of a time-varying one, its last."""
        mean, (spread, _) = self._moments(k)
        return self.kind(mean, spread)

    def density(self, k: Array) -> Density:
        """All of it, at instant `k`."""
        mean, spreads = self._moments(k)
        return Normal(mean, *spreads) if self.distribution is None else Given(self.distribution, jnp.zeros_like(mean))

    def _moments(self, k: Array) -> tuple[Array, tuple[Spread, Array]]:
        mean = self.mean[k] if self.mean.ndim == 2 else self.mean
        spreads = self.spread, self.whitening
        return mean, jax.tree.map(lambda a: a[k], spreads) if self.spread.cov.ndim == 3 else spreads
