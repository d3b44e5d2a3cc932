"""How much parameters may have moved between two updates: process noises of parameter estimation.

Source: Wan & van der Merwe, "The Unscented Kalman Filter" (2001), section 7.4.1. Each says which variance every
parameter gains (`added`); how a covariance grows by that is the same for all:

* correlations are kept: row i of a factor is multiplied by √(1 + added_i / P_ii). Exact in both forms, O(L²), and what
  a forgetting factor is by definition;
* or, `on_diagonal`, as in the papers: a dense covariance gains a diagonal, a factor the D of S + D, so that its own
  diagonal has the right size. The two differ where parameters are correlated.
"""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sigmapoint import checks
from sigmapoint.learning.uncertainty import Uncertainty

MOST = 1e6
"""A forgetting factor lets no variance grow beyond so many times that of the prior."""


@runtime_checkable
class Drift(Protocol):
    """A schedule of process noise. What it remembers is an array or nothing."""

    def start(self, variance: Float[Array, " L"]) -> Any:
        """The memory before the first sample."""
        ...

    def added(self, memory: Any, variance: Float[Array, " L"], step: Int[Array, ""]) -> Float[Array, " L"]:
        """The variance that each parameter gains before update number `step`."""
        ...

    def after(self, memory: Any, moved: Float[Array, " L"]) -> Any:
        """The memory after an update that has moved the mean by so much."""
        ...

    def inflated(self, uncertainty: Any, added: Float[Array, " L"]) -> Any:
        """`uncertainty` with that."""
        ...


@dataclass(frozen=True)
class Schedule:
    """What schedules have in common: no memory, and correlations are kept."""

    def start(self, variance: Float[Array, " L"]) -> Any:
        return None

    def after(self, memory: Any, moved: Float[Array, " L"]) -> Any:
        return None

    def inflated(self, uncertainty: Uncertainty, added: Float[Array, " L"]) -> Uncertainty:
        return uncertainty.inflated(added)


@dataclass(frozen=True)
class Annealed(Schedule):
    """q rateᵏ, never below the floor."""

    q: float
    rate: float
    floor: float

    def added(self, memory: Any, variance: Float[Array, " L"], step: Int[Array, ""]) -> Float[Array, " L"]:
        q = jnp.maximum(self.q * self.rate ** step.astype(variance.dtype), self.floor)
        return jnp.full_like(variance, q)


@dataclass(frozen=True)
class Forgetting(Schedule):
    """P / λ, as long as that is not beyond all bounds: what is never seen would grow for ever."""

    factor: float

    def start(self, variance: Float[Array, " L"]) -> Any:
        return variance

    def added(self, memory: Any, variance: Float[Array, " L"], step: Int[Array, ""]) -> Float[Array, " L"]:
        return jnp.minimum(variance * (1 / self.factor - 1), jnp.maximum(MOST * memory - variance, 0.0))

    def after(self, memory: Any, moved: Float[Array, " L"]) -> Any:
        return memory


@dataclass(frozen=True)
class RobbinsMonro(Schedule):
    """q ← (1 − rate) q + rate · (how far the last update moved)²."""

    q: float
    rate: float

    def start(self, variance: Float[Array, " L"]) -> Any:
        return jnp.full_like(variance, self.q)

    def added(self, memory: Any, variance: Float[Array, " L"], step: Int[Array, ""]) -> Float[Array, " L"]:
        return memory

    def after(self, memory: Any, moved: Float[Array, " L"]) -> Any:
        return (1 - self.rate) * memory + self.rate * moved**2


@dataclass(frozen=True)
class OnDiagonal:
    """Another drift, added in the papers' way."""

    drift: Drift

    def start(self, variance: Float[Array, " L"]) -> Any:
        return self.drift.start(variance)

    def added(self, memory: Any, variance: Float[Array, " L"], step: Int[Array, ""]) -> Float[Array, " L"]:
        return self.drift.added(memory, variance, step)

    def after(self, memory: Any, moved: Float[Array, " L"]) -> Any:
        return self.drift.after(memory, moved)

    def inflated(self, uncertainty: Uncertainty, added: Float[Array, " L"]) -> Uncertainty:
        return uncertainty.on_diagonal(added)


def drift_of(drift: Any) -> Drift:
    """As given by a user: nothing stands for parameters that stay, a number q for `fixed(q)`.

    Raises:
        ValueError: something else.
    """
    if isinstance(drift, int | float | np.number | np.ndarray) and np.ndim(drift) == 0:
        return fixed(checks.number("drift", drift))
    given: Any = fixed(0.0) if drift is None else drift
    checks.instance("drift", given, Drift, "a number, sp.fixed(), sp.annealed(), sp.forgetting() or sp.robbins_monro()")
    return given


def fixed(q: float) -> Drift:
    """The same variance at every update: for parameters that drift, and to keep learning.

    Args:
        q: variance gained by each parameter and update, in its own squared units; 0 for constants.

    Raises:
        ValueError: a negative number.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.fixed(1e-6).q
        1e-06
    """
    return annealed(q, 1.0)


def annealed(q: float, rate: float, floor: float = 0.0) -> Drift:
    """A variance that shrinks: q rateᵏ at update k, never below `floor`.

    Args:
        q: variance gained at the first update, in squared units of the parameters.
        rate: its factor from update to update, in (0, 1].
        floor: where it stops, so that learning does not.

    Raises:
        ValueError: a negative variance, a rate outside (0, 1].

    Examples:
        >>> import sigmapoint as sp
        >>> sp.annealed(1e-3, 0.99, floor=1e-8).rate
        0.99
    """
    return Annealed(_variance("q", q), checks.fraction("rate", rate), _variance("floor", floor))


def forgetting(factor: float) -> Drift:
    """Recursive least squares' exponential forgetting: P / λ at every update.

    Args:
        factor: λ in (0, 1]; what was learned n updates ago counts λⁿ. 0.9995 remembers about 2000. A parameter
            that nothing is learned about forgets no further than to a thousand times its prior standard deviation.

    Raises:
        ValueError: a number outside (0, 1].

    Examples:
        >>> import sigmapoint as sp
        >>> sp.forgetting(0.9995).factor
        0.9995
    """
    return Forgetting(checks.fraction("factor", factor))


def robbins_monro(q: float, rate: float) -> Drift:
    """Process noise estimated from how far updates move each parameter (a diagonal, by stochastic approximation).

    Args:
        q: variance at the start, in squared units of the parameters.
        rate: how much of each new square enters, in (0, 1]; about 1 / (updates to average over).

    Raises:
        ValueError: a negative variance, a rate outside (0, 1].

    Examples:
        >>> import sigmapoint as sp
        >>> sp.robbins_monro(1e-4, 0.01).rate
        0.01
    """
    return RobbinsMonro(_variance("q", q), checks.fraction("rate", rate))


def on_diagonal(drift: Drift) -> Drift:
    """The same drift added to the diagonal, as in the papers, in place of keeping correlations.

    Args:
        drift: any.

    Raises:
        ValueError: not a drift.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.on_diagonal(sp.fixed(1e-6)).drift.q
        1e-06
    """
    checks.instance("drift", drift, Drift, "sp.fixed(), sp.annealed(), sp.forgetting() or sp.robbins_monro()")
    return OnDiagonal(drift)


def _variance(name: str, value: Any) -> float:
    value = checks.number(name, value)
    if not 0 <= value < float("inf"):
        raise ValueError(f"{name} is a variance: it must be finite and not negative, got {value}")
    return value
