"""A transition the other way round: x[k] given x[k+1] and the measurements up to instant k.

    x[k] = m[k] + G (x[k+1] − m[k+1|k]) + B ε,      G = P[k, k+1] P[k+1|k]⁻¹,      B Bᵀ = P[k] − G P[k+1|k] Gᵀ

Found by `condition`, as the update with a measurement that is the next state: no downdate, and a state that is known
exactly makes no trouble. All that looks `back` is made of it: smoothers put a belief about x[k+1] in, draws of a
trajectory a point.

Source: Rauch, Tung & Striebel (1965) for the linear case; Särkkä (2008) for sigma points.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sigmapoint.belief import Belief
from sigmapoint.compiled import series
from sigmapoint.compiled.native import applied, product
from sigmapoint.conditioning import condition
from sigmapoint.spaces import Space
from sigmapoint.step import Filter, FilterState


class Reversal(NamedTuple):
    """A transition reversed; see the module."""

    mean: Float[Array, "*T d"]
    """m[k]"""
    ahead: Float[Array, "*T d"]
    """m[k+1|k]"""
    gain: Float[Array, "*T n n"]
    root: Float[Array, "*T n k"]
    """B"""

    @classmethod
    def of(cls, run: Filter, state: FilterState, u: Any) -> "Reversal":
        """That from instant `state.step` to the next, about the filtered belief."""
        joint, _ = run.method.carry.transition(run.method.rule, state.belief, run.functions(state.step), u)
        each = jnp.eye(state.belief.factor.shape[0], dtype=state.mean.dtype)
        given = condition(joint, each, jnp.ones(each.shape[0], bool), run.method.belief)
        return cls(joint.state.mean, joint.value.mean, given.step, given.root)

    def belief(self, space: Space, later: Belief) -> Belief:
        """About x[k], from one about x[k+1] that knows more than its prediction did."""
        mean = space.retract(self.mean, applied(self.gain, space.residual(later.mean, self.ahead)))
        columns = jnp.concatenate([product(self.gain, later.factor), self.root], axis=1)
        return type(later).from_root(mean, columns)

    def point(self, space: Space, later: Float[Array, " d"], noise: Float[Array, " k"]) -> Float[Array, " d"]:
        """A draw of x[k], from one of x[k+1] and standard normal noise."""
        step = applied(self.gain, space.residual(later, self.ahead)) + applied(self.root, noise)
        return space.retract(self.mean, step)


def last_row(T: int, real: Array | None = None) -> Int[Array, ""]:
    """Index of the last of T rows; of those that are `real`, where not all are."""
    return jnp.asarray(T, int) - 1 if real is None else jnp.sum(real, dtype=int) - 1


def back(
    run: Filter,
    states: FilterState,
    u: Any,
    step: Callable[[Any, Reversal, FilterState], Any],
    start: Callable[[Belief], Any] = lambda belief: belief,
    out: Callable[[Any, Reversal], Any] = lambda later, reversal: later,
    real: Array | None = None,
) -> Any:
    """From the last instant back to the first, one reversed transition after the other.

    Args:
        run: the filter.
        states: what it has found, with a leading axis T.
        u: inputs, likewise.
        step: `(later, reversal, state)` to what is true of the state's instant, where `later` is of the next one.
        start: what is true of the last instant, from the filtered belief about it.
        out: what to keep of an instant; the reversal is of no account at the last one.
        real: which rows there are; what is kept of others is of no account.

    Returns:
        What `out` keeps, with a leading axis T.
    """
    T = states.step.shape[0]
    last = last_row(T, real)

    def one(later: Any, row: tuple[Array, FilterState, Any]) -> tuple[Any, Any]:
        k, state, u = row
        reversal = Reversal.of(run, state, u)
        here = jax.tree.map(lambda a, b: jnp.where(k < last, a, b), step(later, reversal, state), later)
        return here, out(here, reversal)

    end = start(jax.tree.map(lambda a: a[last], states.belief))
    return series.scan(one, end, (jnp.arange(T), states, u), reverse=True)[1]
