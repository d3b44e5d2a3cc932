"""One step of a filter: what it knows, and how a measurement and the passing of time change that.

`filtering` takes it over a series, `online` hands it out. Every method differs in the parts it is made of (rule,
belief, carry), not here.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from sigmapoint import function_checks
from sigmapoint.belief import Belief, covariance
from sigmapoint.carry import Functions, Points
from sigmapoint.conditioning import Conditioned, condition
from sigmapoint.folding import folded
from sigmapoint.iterate import relinearized
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel
from sigmapoint.noise import NoiseSeries

LOG_2PI = 1.8378770664093453


class FilterState(NamedTuple):
    """What a filter knows at instant `step`: a belief, and the points that stand for it where a method carries them.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x[:1], jnp.eye(2), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(2), jnp.eye(2)))
        >>> state = sp.online(model).init()
        >>> state.mean.shape, state.cov.shape, state.std.shape, int(state.step)
        ((2,), (2, 2), (2,), 0)
    """

    belief: Belief
    points: Points
    step: Int[Array, ""]

    @property
    def mean(self) -> Float[Array, "*T d"]:
        """Mean of the state, in its units."""
        return self.belief.mean

    @property
    def cov(self) -> Float[Array, "*T n n"]:
        """Covariance of the state, in products of its units."""
        return self.belief.cov

    @property
    def std(self) -> Float[Array, "*T n"]:
        """Standard deviations of the state's elements, in their units."""
        return self.belief.std


class Info(NamedTuple):
    """What an update saw, all of it by the prediction made before.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> live = sp.online(model)
        >>> _, info = live.update(live.init(), [2.0])
        >>> float(info.innovation[0]), float(info.innovation_cov[0, 0]), round(float(info.nis), 6)
        (2.0, 2.0, 2.0)
    """

    innovation: Float[Array, " m"]
    """Measured minus predicted, in the units of the measurement; NaN where nothing was measured."""
    innovation_cov: Float[Array, "m m"]
    """Its covariance as predicted, in products of these units, also where nothing was measured."""
    nis: Float[Array, ""]
    """Normalised innovation squared [1], over the elements measured: their number on average if the model is right."""
    log_likelihood: Float[Array, ""]
    """Natural logarithm of the predicted density of what was measured (a density in the inverse units of `y`)."""

    @classmethod
    def of(cls, given: Conditioned, innovation: Array, cov: Array, active: Array) -> "Info":
        """From a prediction that has been conditioned on the measurement."""
        nis = jnp.sum(given.white**2)
        count = jnp.sum(given.informative, dtype=nis.dtype)
        log_density = -0.5 * (nis + count * LOG_2PI + jnp.sum(jnp.log(given.variance)))
        return cls(jnp.where(active, innovation, jnp.nan), cov, nis, log_density)


class Filter(NamedTuple):
    """A model made ready for a method: noises factored, functions checked as they are traced."""

    model: StateSpaceModel
    method: Method
    process: NoiseSeries
    observation: NoiseSeries

    @classmethod
    def of(cls, model: StateSpaceModel, method: Method) -> "Filter":
        dtype = model.initial.mean.dtype
        noises = (NoiseSeries.of(n, dtype) for n in (model.process_noise, model.observation_noise))
        return cls(model, method, *noises)

    def functions(self, k: Array, observed: tuple[int, ...] | None = None) -> Functions:
        """The model at instant `k`; `observed` is the shape that h has to return."""
        model, dtype = self.model, self.model.initial.mean.dtype

        def f(*args: Any) -> Array:
            value = function_checks.called("dynamics", model.dynamics, *args)
            return function_checks.returned("dynamics", value, model.initial.mean.shape, "the next state").astype(dtype)

        def h(*args: Any) -> Array:
            value = function_checks.called("observation", model.observation, *args)
            if observed is not None:
                function_checks.columns(observed[0], value)
                value = function_checks.returned("observation", value, observed, "one element for each column of y")
                size = jax.eval_shape(model.observation_space.residual, value, value).shape[0]
                model.observation_noise.fits("observation_noise", size, "row of y")
            return jnp.asarray(value).astype(dtype)

        noises = self.process.at(k), self.observation.at(k)
        return Functions(folded(f), folded(h), *noises, model.state_space, model.observation_space)

    def init(self) -> FilterState:
        """The initial belief, at instant 0."""
        initial = self.model.initial
        belief = self.method.belief.of(initial.mean, initial.cov.astype(initial.mean.dtype))
        return self._state(belief, jnp.zeros((), int))

    def predict(self, state: FilterState, u: Any) -> FilterState:
        """The belief about the next instant."""
        joint, points = self.method.carry.transition(self.method.rule, state.belief, self.functions(state.step), u)
        return FilterState(self.method.belief.marginal(joint.value, joint.noise), points, state.step + 1)

    def update(self, state: FilterState, y: Float[Array, " d"], u: Any) -> tuple[FilterState, Info]:
        """The belief after a measurement; elements that are NaN were not measured."""
        belief, fs = state.belief, self.functions(state.step, y.shape)
        active = measured(y, jax.eval_shape(fs.observation_space.residual, y, y).shape[0])
        joint = self.method.carry.measurement(self.method.rule, belief, state.points, fs, u)
        innovation = fs.innovation(y, joint.value.mean, active)
        given = condition(joint, innovation[:, None], active, self.method.belief)
        info = Info.of(given, innovation, covariance(joint.value, joint.noise), active)
        if self.method.iterations > 1:
            passes = self.method.iterations - 1
            joint, innovation = relinearized(self.method.rule, passes, joint, belief, fs, y, u, active)
            given = condition(joint, innovation[:, None], active, self.method.belief)
        mean = fs.state_space.retract(joint.state.mean, given.step[:, 0])
        return self._state(type(belief).from_root(mean, given.root), state.step), info

    def _state(self, belief: Belief, step: Array) -> FilterState:
        points = self.method.carry.draw(self.method.rule, belief, self.functions(step))
        return FilterState(belief, points, step)


def measured(y: Array, size: int) -> Bool[Array, " m"]:
    """Which elements of an innovation of that size were measured; on a manifold, all or none."""
    missing = jnp.isnan(y)
    return ~missing if y.shape[0] == size else jnp.broadcast_to(~missing.any(), (size,))
