"""Filtering: predict, update, and both over a series.

One step is `update` with y[k] and then `predict` with u[k]; `filter` scans it, `online` hands it out. Every method
differs in the parts it is made of (rule, belief, carry), not here.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from sigmapoint import checks, series
from sigmapoint.belief import Belief, covariance
from sigmapoint.blackbox import unwrapped
from sigmapoint.carry import Functions, Points
from sigmapoint.conditioning import Conditioned, condition
from sigmapoint.folding import folded
from sigmapoint.iterate import relinearized
from sigmapoint.methods import Method, srcdkf
from sigmapoint.model import StateSpaceModel
from sigmapoint.noise import NoiseSeries
from sigmapoint.results import FIELDS, Labels, Posterior
from sigmapoint.rules.linearization import SigmaPointRule

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
    def mean(self) -> Float[Array, " d"]:
        """Mean of the state, in its units."""
        return self.belief.mean

    @property
    def cov(self) -> Float[Array, "n n"]:
        """Covariance of the state, in products of its units."""
        return self.belief.cov

    @property
    def std(self) -> Float[Array, " n"]:
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
            value = checks.called("dynamics", model.dynamics, *args)
            return checks.returned("dynamics", value, model.initial.mean.shape, "the next state").astype(dtype)

        def h(*args: Any) -> Array:
            value = checks.called("observation", model.observation, *args)
            if observed is not None:
                checks.columns(observed[0], value)
                value = checks.returned("observation", value, observed, "one element for each column of y")
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
        y_known = jnp.where(jnp.isnan(y), joint.value.mean, y)
        innovation = jnp.where(active, fs.observation_space.residual(y_known, joint.value.mean), 0.0)
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


def filter(
    model: StateSpaceModel,
    y: Any,
    u: Any = None,
    method: Method | None = None,
    *,
    keep: tuple[str, ...] = FIELDS,
) -> Posterior:
    """Estimate the states of a model from measurements, each from those up to its own instant.

    Args:
        model: the model.
        y: measurements (T, m), in the units of the observation function; NaN where an element was not measured.
        u: inputs, any pytree of arrays with leading axis T, or nothing.
        method: how, e.g. `srukf()`, `ekf()`; `srcdkf()` where not given.
        keep: which results to keep, to save memory on long series: a selection of `mean`, `cov`, `std`, `innovation`,
            `innovation_cov`, `nis`. The log-likelihood is always kept.

    Returns:
        A `Posterior` of filtered beliefs.

    Raises:
        ValueError: shapes that do not fit, NaN in `u`, infinite measurements, an unknown name in `keep`.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> post = sp.filter(model, jnp.array([[1.0], [jnp.nan], [0.5]]), method=sp.ukf())
        >>> post.mean.shape, post.log_likelihood.shape
        ((3, 1), ())
    """
    y, u, method = prepared(model, y, u, method)
    keep = checks.selection("keep", keep, FIELDS)
    kept = unwrapped(estimate, model, y, u, method, Forward(), keep)
    return Posterior.of(model, y, u, kept)


def prepared(model: StateSpaceModel, y: Any, u: Any, method: Method | None = None) -> tuple[Array, Any, Method]:
    """Checked measurements and inputs, and the method or its default."""
    method = fitting(model, method)
    return *series_of(model, y, u), method


def series_of(model: StateSpaceModel, y: Any, u: Any, longest: int | None = None) -> tuple[Array, Any]:
    """Measurements and inputs, checked against the model; `longest` where they hold several series."""
    checks.instance("model", model, StateSpaceModel)
    y, u = checks.series(y, u, model.initial.mean.dtype)
    checks.space("observation_space", model.observation_space, y.shape[1])
    Labels.of(model, y.shape[1])
    T = y.shape[0] if longest is None else longest
    checks.long_enough(T, process_noise=model.process_noise, observation_noise=model.observation_noise)
    return y, u


def fitting(model: StateSpaceModel, method: Method | None) -> Method:
    """The method, or its default, checked together with the model."""
    method = srcdkf() if method is None else method
    checks.instance("model", model, StateSpaceModel)
    checks.instance("method", method, Method)
    if isinstance(method.rule, SigmaPointRule):
        constants = method.rule.constants(model.initial.cov.shape[-1])
        checks.digits(float(abs(constants.mean[0])), model.initial.mean.dtype)
        reach = float(abs(constants.points).max())
        checks.room(model.initial, reach, model.state_space, model.state_names)
    return method


class Estimator(ABC):
    """What a series is worked through by: a filter or a smoother, with its settings."""

    @abstractmethod
    def __call__(
        self, run: Filter, y: Array, u: Any, keep: tuple[str, ...], real: Array | None = None
    ) -> dict[str, Array]:
        """The fields named in `keep`, and the log-likelihood, over a series; of the rows that are `real`, if given."""


@dataclass(frozen=True)
class Forward(Estimator):
    """The filter: each state from the measurements up to its own instant."""

    def __call__(
        self, run: Filter, y: Array, u: Any, keep: tuple[str, ...], real: Array | None = None
    ) -> dict[str, Array]:
        kept, log_likelihood, _ = scan(run, y, u, lambda state, info: fields(keep, state, info), real)
        return {**kept, "log_likelihood": log_likelihood}


@eqx.filter_jit
def estimate(
    model: StateSpaceModel, y: Array, u: Any, method: Method, estimator: Estimator, keep: tuple[str, ...]
) -> dict[str, Array]:
    """One series through an estimator."""
    return estimator(Filter.of(model, method), y, u, keep)


def scan(
    run: Filter, y: Array, u: Any, out: Callable[[FilterState, Info], Any], real: Array | None = None
) -> tuple[Any, Float[Array, ""], FilterState]:
    """Update and predict over a series: what `out(state, info)` keeps, the log-likelihood, and the state ahead.

    Rows that are not `real` fill up: they leave everything as it is.
    """

    def step(carry: tuple[FilterState, Array], row: tuple[Array, Any]) -> tuple[tuple[FilterState, Array], Any]:
        state, total = carry
        state, info = run.update(state, *row)
        return (run.predict(state, row[1]), total + info.log_likelihood), out(state, info)

    start = (run.init(), jnp.zeros((), y.dtype))
    (ahead, total), kept = series.scan(step, start, (y, u), real=real)
    return kept, total, ahead


def fields(keep: tuple[str, ...], *sources: Any) -> dict[str, Array]:
    """The fields named in `keep`, each from the first source that has it."""
    found = {name: next((s for s in sources if hasattr(type(s), name)), None) for name in keep}
    return {name: getattr(source, name) for name, source in found.items() if source is not None}


def measured(y: Array, size: int) -> Bool[Array, " m"]:
    """Which elements of an innovation of that size were measured; on a manifold, all or none."""
    missing = jnp.isnan(y)
    return ~missing if y.shape[0] == size else jnp.broadcast_to(~missing.any(), (size,))
