"""How sigma points get from f to h: drawn anew after the time update, or one set through both.

A strategy says which noises have coordinates in the point set, and what a state carries beside its belief.

* `Redraw` (Table 7.3.2): a set for f, another for h; additive noise stays outside.
* `ExtendedSet` (footnote 6): the set covers (x, w); its propagated points go through h.
* `Augmented` (Table 7.3.1): the set covers (x, w, v).

Source: Wan & van der Merwe, "The Unscented Kalman Filter" (2001), section 7.3. In the last two the weights are those of
the whole dimension of the set. Points are kept as values of the state; the coordinates of the noises are constants of
the rule. So a prediction and the update after it use one set, and an update after an update draws a fresh one.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint.belief import Belief
from sigmapoint.compiled.native import applied
from sigmapoint.conditioning import Joint
from sigmapoint.entering import Entry, Noise
from sigmapoint.rules.linearization import Linearization, Rule, magnitude
from sigmapoint.spaces import Space


class Functions(NamedTuple):
    """The model at one instant, as a step sees it."""

    f: Callable[..., Array]
    h: Callable[..., Array]
    process: Noise
    observation: Noise
    state_space: Space
    observation_space: Space

    def innovation(self, y: Float[Array, " d"], predicted: Float[Array, " d"], active: Array) -> Float[Array, " m"]:
        """Measured minus predicted; zero where nothing was measured."""
        known = jnp.where(jnp.isnan(y), predicted, y)
        return jnp.where(active, self.observation_space.residual(known, predicted), 0.0)


NEARBY = 2.0**-10
"""How far away, relative to its size, a state is moved to see the size of the terms in a function."""

Points = Float[Array, "p d"] | None


@runtime_checkable
class Carry(Protocol):
    """A strategy; see the module."""

    def dimensions(self, n: int, process: Any, observation: Any) -> int:
        """Of the smallest point set, for a state with `n` and noises as a model has them."""
        ...

    def draw(self, rule: Any, belief: Belief, fs: Functions) -> Points:
        """The state's points of a fresh set, or nothing where points are not carried."""
        ...

    def transition(self, rule: Any, belief: Belief, fs: Functions, u: Any) -> tuple[Joint, Points]:
        """x[k+1] jointly with x[k], and the propagated points."""
        ...

    def measurement(self, rule: Any, belief: Belief, points: Points, fs: Functions, u: Any) -> Joint:
        """y[k] jointly with x[k]."""
        ...


@dataclass(frozen=True)
class Redraw:
    """A fresh set for every function."""

    def dimensions(self, n: int, process: Any, observation: Any) -> int:
        return n + min(process.inside, observation.inside)

    def draw(self, rule: Rule, belief: Belief, fs: Functions) -> Points:
        return None

    def transition(self, rule: Rule, belief: Belief, fs: Functions, u: Any) -> tuple[Joint, Points]:
        entry = fs.process.within(fs.f, fs.state_space)
        return stacked(rule, belief, entry, u, fs.state_space, fs.state_space), None

    def measurement(self, rule: Rule, belief: Belief, points: Points, fs: Functions, u: Any) -> Joint:
        entry = fs.observation.within(fs.h, fs.observation_space)
        return stacked(rule, belief, entry, u, fs.state_space, fs.observation_space)


@dataclass(frozen=True)
class ExtendedSet:
    """One set for (x, w), and for v where it is not additive."""

    def dimensions(self, n: int, process: Any, observation: Any) -> int:
        return n + process.size + observation.inside

    def _observed(self, fs: Functions) -> Entry:
        return fs.observation.within(fs.h, fs.observation_space)

    def _size(self, belief: Belief, fs: Functions) -> int:
        noises = fs.process.through(fs.f, fs.state_space).size + self._observed(fs).size
        return belief.factor.shape[0] + noises

    def draw(self, rule: Any, belief: Belief, fs: Functions) -> Points:
        points = jnp.asarray(rule.constants(self._size(belief, fs)).points, belief.mean.dtype)
        n = belief.factor.shape[0]
        return jax.vmap(whitened(belief, fs.state_space))(points[:, :n])

    def transition(self, rule: Any, belief: Belief, fs: Functions, u: Any) -> tuple[Joint, Points]:
        entry = fs.process.through(fs.f, fs.state_space)
        n, N = belief.factor.shape[0], self._size(belief, fs)
        at = whitened(belief, fs.state_space)
        points = jnp.asarray(rule.constants(N).points, belief.mean.dtype)
        values = jax.vmap(lambda xi: entry.call(at(xi[:n]), u, xi[n : n + entry.size]))(points)
        state = known(belief, N)
        return Joint(rule.combine(values, N, fs.state_space), state, None), values

    def measurement(self, rule: Any, belief: Belief, points: Points, fs: Functions, u: Any) -> Joint:
        entry, N = self._observed(fs), self._size(belief, fs)
        noises = jnp.asarray(rule.constants(N).points, belief.mean.dtype)[:, N - entry.size :]
        values = jax.vmap(lambda x, xi: entry.call(x, u, xi))(points, noises)
        value = rule.combine(values, N, fs.observation_space)
        return Joint(value, rule.combine(points, N, fs.state_space), entry.rest)


@dataclass(frozen=True)
class Augmented(ExtendedSet):
    """One set for (x, w, v)."""

    def dimensions(self, n: int, process: Any, observation: Any) -> int:
        return n + process.size + observation.size

    def _observed(self, fs: Functions) -> Entry:
        return fs.observation.through(fs.h, fs.observation_space)


def stacked(rule: Rule, belief: Belief, entry: Entry, u: Any, inside: Space, outside: Space) -> Joint:
    """A function of (x, its noise) linearised about the belief, jointly with x."""
    displaced, factor = around(belief, entry, u, inside)
    n, N = factor.shape[0] - entry.size, factor.shape[0]
    value = rule(displaced, factor, outside)
    if entry.rest is not None:

        def terms() -> Array:
            moved = displaced(jnp.pad(NEARBY * _terms(belief), (0, N - n)))
            return jnp.abs(outside.residual(moved, value.mean)) / NEARBY

        # Where a sensor is exact, the points agree in what it has measured, and their values do not show how large the
        # terms are that cancel in them: x₁ − x₂ = 0 of two large states. A point that does not agree does.
        exact = jnp.any(jnp.diagonal(entry.rest.cov) == 0)
        value = value._replace(scale=value.scale + jax.lax.cond(exact, terms, lambda: jnp.zeros_like(value.scale)))
    return Joint(value, known(belief, N), entry.rest)


def around(belief: Belief, entry: Entry, u: Any, inside: Space) -> tuple[Callable[[Array], Array], Float[Array, "N N"]]:
    """A function of (x, its noise) in displacements from the belief's mean, and a factor of their covariance."""
    n, dtype = belief.factor.shape[0], belief.mean.dtype
    eye = jnp.eye(entry.size, dtype=dtype)
    factor = jax.scipy.linalg.block_diag(belief.factor, eye) if entry.size else belief.factor
    return lambda d: entry.call(inside.retract(belief.mean, d[:n]), u, d[n:]), factor


def _terms(belief: Belief) -> Float[Array, " n"]:
    """The size of each coordinate, with signs and factors that no function is likely to cancel."""
    size = magnitude(belief.mean[None], belief.factor.shape[0]) + belief.std
    mixed = np.random.default_rng(0).uniform(0.5, 1.0, size.shape[0]) * (-1.0) ** np.arange(size.shape[0])
    return size * jnp.asarray(mixed, size.dtype)


def whitened(belief: Belief, space: Space) -> Callable[[Array], Array]:
    """ξ ↦ x = m + L ξ."""
    mean, factor = belief.mean, belief.factor
    return lambda xi: space.retract(mean, applied(factor, xi))


def known(belief: Belief, N: int) -> Linearization:
    """The state itself, over the N coordinates of the points."""
    n = belief.factor.shape[0]
    slope = jnp.pad(belief.factor, ((0, 0), (0, N - n)))
    return Linearization(belief.mean, slope, slope[:, :0], jnp.zeros(n, slope.dtype), slope[:, :0])
