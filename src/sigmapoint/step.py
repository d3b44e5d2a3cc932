"""One step of a Gaussian filter: what it knows, and how a measurement and the passing of time change that.

`filtering` takes it over a series, `online` hands it out. Every method differs in the parts it is made of (rule,
belief, carry), not here.
"""

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sigmapoint.belief import Belief, covariance
from sigmapoint.carry import Carry, Functions, Points, Redraw
from sigmapoint.checks import belief_checks
from sigmapoint.conditioning import Conditioned, condition
from sigmapoint.densities import LOG_2PI
from sigmapoint.entering import NoiseSeries
from sigmapoint.iterate import relinearized
from sigmapoint.model import StateSpaceModel
from sigmapoint.results import Posterior
from sigmapoint.rules.linearization import Rule, SigmaPointRule
from sigmapoint.system import System, measured


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


@dataclass(frozen=True)
class Method:
    """A Gaussian filter: `rule` × `belief`, how points are carried from f to h, and how often an update is iterated.

    Args:
        rule: how functions are linearised.
        belief: what is carried from step to step, a covariance or a square root of it.
        carry: what h gets to see, new points or those of f.
        iterations: number of passes of an update; 1 is the plain filter.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.srcdkf().belief.__name__
        'SquareRoot'
    """

    rule: Rule
    belief: type[Belief]
    carry: Carry = Redraw()  # noqa: RUF009 (frozen, without fields)
    iterations: int = 1

    posterior: ClassVar[type[Posterior]] = Posterior
    state: ClassVar[type] = FilterState
    smoothers: ClassVar[str] = "sp.rts(), sp.two_filter(), sp.fixed_lag(lag) or sp.ipls()"

    def fits(self, model: StateSpaceModel) -> None:
        """Raise where the model has what no Gaussian stands for, or no room for the points."""
        for name in ("process_noise", "observation_noise"):
            belief_checks.gaussian(name, getattr(model, name))
        if isinstance(self.rule, SigmaPointRule):
            n = model.initial.cov.shape[-1]
            constants = self.rule.constants(self.carry.dimensions(n, model.process_noise, model.observation_noise))
            belief_checks.digits(abs(constants.centre), model.initial.mean.dtype)
            belief_checks.room(model.initial, constants.reach, model.state_space, model.state_names)

    def random(self, key: Any) -> None:
        """Nothing is drawn: a key that others need is of no account here."""

    def ready(self, model: StateSpaceModel, key: Any = None) -> "Filter":
        """The model made ready."""
        return Filter.of(model, self)


class Filter(NamedTuple):
    """A model made ready for a method: noises factored, functions checked as they are traced."""

    model: StateSpaceModel
    method: Method
    process: NoiseSeries
    observation: NoiseSeries

    @classmethod
    def of(cls, model: StateSpaceModel, method: Method) -> "Filter":
        _, process, observation = System.of(model)
        return cls(model, method, process, observation)

    @property
    def system(self) -> System:
        """The model and its noises."""
        return System(self.model, self.process, self.observation)

    def functions(self, k: Array, observed: tuple[int, ...] | None = None) -> Functions:
        """The model at instant `k`; `observed` is the shape that h has to return."""
        return self.system.functions(k, observed)

    def init(self) -> FilterState:
        """The initial belief, at instant 0."""
        initial = self.model.initial
        belief = self.method.belief.of(initial.mean, initial.cov.astype(initial.mean.dtype))
        return self.about(belief, jnp.zeros((), int))

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
        return self.about(type(belief).from_root(mean, given.root), state.step), info

    def expected(self, state: FilterState, y: Float[Array, " d"], u: Any) -> tuple[Array, Array]:
        """Mean and covariance of a measurement of the size of `y`, as predicted."""
        fs = self.functions(state.step, y.shape)
        joint = self.method.carry.measurement(self.method.rule, state.belief, state.points, fs, u)
        return joint.value.mean, covariance(joint.value, joint.noise)

    def about(self, belief: Belief, step: Array) -> FilterState:
        """A state with that belief."""
        points = self.method.carry.draw(self.method.rule, belief, self.functions(step))
        return FilterState(belief, points, step)
