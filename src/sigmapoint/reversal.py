"""A transition the other way round: x[k] given x[k+1] and the measurements up to instant k.

    x[k] = m[k] + G (x[k+1] − m[k+1|k]) + B ε,      G = P[k, k+1] P[k+1|k]⁻¹,      B Bᵀ = P[k] − G P[k+1|k] Gᵀ

Found by `condition`, as the update with a measurement that is the next state: no downdate, and a state that is known
exactly makes no trouble. All that looks back is made of it: smoothers put a belief about x[k+1] in, draws of a
trajectory a point.

Source: Rauch, Tung & Striebel (1965) for the linear case; Särkkä (2008) for sigma points.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint.belief import Belief
from sigmapoint.conditioning import condition
from sigmapoint.native import applied, product
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
