"""One step of a state filter as a function with a memory, whose parameters a learner can learn.

    memory = (mean, lower factor) of the belief about x[k−1] after y[k−1];
    it goes through predict(u[k−1]) and update(y[k], u[k]) of the model with parameters z.

So the learner follows the derivative of mean *and covariance* in the parameters through all steps, and that of the gain
is not left out (Wan & Nelson 2001, section 5.4.2, "recurrent derivatives").
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sigmapoint.belief import Belief
from sigmapoint.identification.costs import Cost, Seen
from sigmapoint.identification.joint import built
from sigmapoint.identification.unknowns import Unknowns
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel
from sigmapoint.noise import Additive, NonAdditive
from sigmapoint.spaces import Space, beside
from sigmapoint.step import Filter, FilterState, Info


class Sample(NamedTuple):
    """What a step takes in."""

    k: Int[Array, "*T"]
    y: Float[Array, "*T m"]
    u: Any
    before: Any
    """the input of the instant before; of no account at the first"""


class Cell(eqx.Module):
    """A state filter with unknown parameters."""

    build: Callable[[Any], StateSpaceModel] = eqx.field(static=True)
    unknowns: Unknowns
    method: Method = eqx.field(static=True)
    cost: Cost = eqx.field(static=True)
    space: Space = eqx.field(static=True)
    """of the state"""
    point: int = eqx.field(static=True)
    """its numbers"""
    directions: int = eqx.field(static=True)

    def model(self, z: Float[Array, " L"]) -> StateSpaceModel:
        """With parameters z."""
        return built(self.build, self.unknowns.tree(z))

    def step(self, z: Float[Array, " L"], memory: Float[Array, " H"], sample: Sample) -> tuple[FilterState, Info]:
        """The belief after a sample, and what that looked like."""
        run = Filter.of(_at(self.model(z), sample.k), self.method)
        dtype = run.model.initial.mean.dtype
        before = FilterState(self.belief(memory.astype(dtype)), None, sample.k - 1)
        ahead = jax.lax.cond(sample.k == 0, run.init, lambda: run.predict(before, sample.before))
        return run.update(ahead, sample.y.astype(dtype), sample.u)

    def belief(self, memory: Float[Array, " H"]) -> Belief:
        """As the method holds it."""
        n, lower = self.directions, np.tril(np.ones((self.directions, self.directions), bool))
        place = np.where(lower, np.cumsum(lower).reshape(n, n) - 1, 0)
        factor = jnp.where(lower, memory[self.point :][place], 0.0)
        return self.method.belief.from_root(memory[: self.point], factor)

    def memory(self, belief: Belief) -> Float[Array, " H"]:
        """The same in one vector."""
        return jnp.concatenate([belief.mean, belief.factor[np.tril_indices(self.directions)]])

    def targets(self, present: Seen) -> Float[Array, "1 r m"]:
        """Of the errors: zero, where there was a measurement."""
        shape = jax.eval_shape(self.cost.errors, present, present).shape
        return jnp.broadcast_to(jnp.where(present.there, 0.0, jnp.nan).astype(present.innovation.dtype), shape)[None]

    # What a learner asks of an objective: inputs are a sample, and what it looks like with the present parameters.

    @property
    def memory_space(self) -> Space:
        return beside(self.space, self.point, self.directions)

    def checked(self, x: Any, d: Any, dtype: Any) -> tuple[Any, Any]:
        return x, d

    def remembered(self, dtype: Any) -> Float[Array, " H"]:
        run = Filter.of(self.model(self.unknowns.prior.mean), self.method)
        return self.memory(run.init().belief).astype(dtype)

    def values(
        self, w: Any, memory: Float[Array, " H"], inputs: tuple[Sample, Seen]
    ) -> tuple[Float[Array, "1 r m"], Array]:
        sample, present = inputs
        state, info = self.step(w, memory, sample)
        return self.cost.errors(Seen.of(info), present)[None], self.memory(state.belief).astype(memory.dtype)

    def prediction(self, w: Any, memory: Float[Array, " H"], x: tuple[Sample, Seen]) -> Array:
        return self.values(w, memory, x)[0][0]

    def predicted_by(self, method: Method) -> Method:
        return method


def _at(model: StateSpaceModel, k: Array) -> StateSpaceModel:
    """With the noises that a step to instant k and a measurement there have."""
    noises = _row(model.process_noise, k - 1), _row(model.observation_noise, k)
    return eqx.tree_at(lambda m: (m.process_noise, m.observation_noise), model, noises)


def _row(noise: Additive | NonAdditive, k: Array) -> Additive | NonAdditive:
    cov = noise.cov[jnp.maximum(k, 0)] if noise.cov.ndim == 3 else noise.cov
    return type(noise)(cov, noise.mean[jnp.maximum(k, 0)] if noise.mean.ndim == 2 else noise.mean)
