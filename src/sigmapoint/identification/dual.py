"""Dual estimation: two coupled filters, one for the states and one for the parameters.

The filter of the parameters is a `learner`, and what it learns is a function with a memory: a step of the filter of the
states (`cell`). Its measurement is what that one has not predicted (`costs`).

Source: Wan & Nelson, "Dual Extended Kalman Filter Methods" (2001), Table 5.3; Wan & van der Merwe, "The Unscented
Kalman Filter" (2001), section 7.5.
"""

import warnings
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from sigmapoint import checks, data_checks, filtering, series
from sigmapoint.blackbox import unwrapped
from sigmapoint.carry import Redraw
from sigmapoint.identification.cell import Cell, Sample
from sigmapoint.identification.costs import Cost, Seen, prediction_error
from sigmapoint.identification.dual_results import DualHistory, DualResult, DualState, root
from sigmapoint.identification.estimates import Estimates
from sigmapoint.identification.unknowns import Unknowns, built
from sigmapoint.learning.drift import Drift
from sigmapoint.learning.learner import fitting
from sigmapoint.learning.parameters import Parameters
from sigmapoint.learning.state import LearnerState
from sigmapoint.learning.update import Setup, updated
from sigmapoint.linalg import norm_rows
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel
from sigmapoint.results import Posterior
from sigmapoint.step import Info


class Dual(eqx.Module):
    """Two coupled filters; made by `dual`. It holds no state: states go in and come out."""

    cell: Cell
    parameters: Parameters
    method: Method = eqx.field(static=True)
    drift: Drift = eqx.field(static=True)

    @property
    def setup(self) -> Setup:
        """Of the learner."""
        return Setup(self.cell, self.parameters, self.method, self.drift, self.cell.cost.noise, None)

    def init(self) -> DualState:
        """The state before the first sample.

        Returns:
            The initial belief of the model with the parameters as they are thought to be, and these.

        Examples:
            >>> import jax.numpy as jnp, sigmapoint as sp
            >>> def build(a):
            ...     return sp.StateSpaceModel(lambda x, u: a * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
            ...                               sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
            >>> float(sp.dual(build, sp.real(0.5, 0.25)).init().estimates.std)
            0.25
        """
        return DualState(self.cell, _started(self), None, jnp.zeros((), int))

    def update(self, state: DualState, y: Any, u: Any = None) -> tuple[DualState, Info]:
        """Go on to the next sample, and take it in.

        Args:
            state: from `init` or `update`, or that of a result.
            y: the measurement (m,), in the units of the observation function; NaN where an element was not measured.
            u: the input of the same instant, any pytree of arrays, or nothing.

        Returns:
            The state at the instant of the sample, and what that looked like by the parameters before.

        Raises:
            ValueError: a state that is none, a measurement of another shape, infinite values, NaN in `u`.

        Examples:
            >>> import jax.numpy as jnp, sigmapoint as sp
            >>> def build(a):
            ...     return sp.StateSpaceModel(lambda x, u: a * x + u, lambda x, u: x, jnp.eye(1), jnp.eye(1),
            ...                               sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
            >>> both = sp.dual(build, sp.real(0.5, 0.3))
            >>> state, info = both.update(both.init(), [2.0], 1.0)
            >>> float(state.mean[0]), float(info.innovation[0]), float(state.theta)
            (1.0, 2.0, 0.5)
        """
        checks.instance("state", state, DualState, "what init() or update() gave")
        y = checks.array("y", y)
        if y.ndim != 1:
            raise ValueError(f"y must be one measurement of shape (m,), got shape {y.shape}")
        data_checks.measured(y)
        u = jax.tree.map(jnp.asarray, data_checks.inputs(u, None, self.parameters.start.dtype))
        before = u if state.previous is None else state.previous
        learner, info = unwrapped(_updated, self, state.learner, Sample(state.step, y, u, before))
        return DualState(self.cell, learner, u, state.step + 1), info

    def filter(self, y: Any, u: Any = None, *, epochs: int = 1, state: DualState | None = None) -> DualResult:
        """Estimate states and parameters from a series, taken once or several times.

        Every epoch starts with the initial belief about the state, and with the parameters as they were at the end of
        the one before. It counts all measurements again: with more than one, error bars say more than the data do, by
        √epochs.

        Args:
            y: measurements (T, m), in the units of the observation function; NaN where an element was not measured.
            u: inputs, any pytree of arrays with leading axis T, or nothing.
            epochs: how often.
            state: whose parameters to start with; `init()` where not given.

        Returns:
            A `DualResult`.

        Raises:
            ValueError: shapes that do not fit, NaN in `u`, infinite measurements, a state that is none.

        Examples:
            >>> import jax.numpy as jnp, sigmapoint as sp
            >>> def build(a):
            ...     return sp.StateSpaceModel(lambda x, u: a * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
            ...                               sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
            >>> result = sp.dual(build, sp.real(0.5, 0.3)).filter(jnp.ones((20, 1)), epochs=2)
            >>> result.post.mean.shape, result.estimates.std.shape, result.history.mse.shape
            ((20, 1), (20,), (2,))
        """
        model = self.cell.model(self.parameters.start)
        y, u = filtering.series_of(model, y, u)
        epochs = checks.whole("epochs", epochs, 1)
        state = self.init() if state is None else state
        checks.instance("state", state, DualState, "what init(), update() or filter() gave")
        before = jax.tree.map(lambda a: jnp.concatenate([a[:1], a[:-1]]), u)
        samples = Sample(jnp.arange(y.shape[0], dtype=int), y, u, before)
        learner, kept, history = state.learner, {}, np.empty((epochs, 2))
        for epoch in range(epochs):
            learner, kept, history[epoch] = unwrapped(through, self, learner, samples)
        last = jax.tree.map(lambda a: a[-1], u)
        self._warn(learner)
        return DualResult(
            Posterior.of(model, y, u, {**kept, "log_likelihood": jnp.sum(kept["log_likelihood"])}),
            _estimates(self.cell.unknowns, kept["z"], kept["z_std"]),
            DualState(self.cell, learner, last, jnp.asarray(y.shape[0], int)),
            DualHistory(*history.T),
        )

    def _warn(self, learner: LearnerState) -> None:
        """Say where the parameters at the end are those of no model: a variance may have become negative."""
        try:
            self.cell.model(learner.mean)
        except ValueError as error:
            warnings.warn(
                f"dual: the parameters at the end make no model: {error}; a variance is sp.positive", stacklevel=3
            )


def _sampled(dual: Dual, learner: LearnerState, sample: Sample) -> tuple[LearnerState, Info]:
    info = dual.cell.step(dual.parameters.tree(learner.mean), learner.memory.mean, sample)[1]
    present = Seen.of(info)
    return updated(dual.setup, learner, (sample, present), dual.cell.targets(present))[0], info


_started = eqx.filter_jit(lambda dual: dual.setup.start())
_updated = eqx.filter_jit(_sampled)
_estimates = eqx.filter_jit(Estimates.of)


@eqx.filter_jit
def through(dual: Dual, learner: LearnerState, samples: Sample) -> tuple[LearnerState, dict[str, Array], Array]:
    """Once through a series."""

    def step(learner: LearnerState, sample: Sample) -> tuple[LearnerState, dict[str, Array]]:
        learner, info = _sampled(dual, learner, sample)
        spread = root(dual.cell, learner)
        state = {"mean": learner.memory.mean[: dual.cell.point], "cov": spread @ spread.T, "std": norm_rows(spread)}
        return learner, {**state, **info._asdict(), "z": learner.mean, "z_std": learner.std}

    learner, kept = series.scan(step, learner._replace(memory=dual.setup.initial_memory), samples)
    return learner, kept, jnp.stack([jnp.nanmean(kept["innovation"] ** 2), jnp.sum(kept["log_likelihood"])])


def dual(
    build: Callable[[Any], StateSpaceModel],
    theta: Any,
    drift: Drift | float | None = None,
    *,
    state_method: Method | None = None,
    parameter_method: Method | None = None,
    cost: Cost | None = None,
) -> Dual:
    """Two coupled filters, one for the states of a model and one for its unknown parameters.

    The parameters' filter sees how the other predicts measurements, and follows how that depends on them through all
    steps, by the derivative of mean and covariance; the gain's is part of it. O((n² + m) L²) a sample for n states, m
    measured elements and L parameters, and L to 2L + 1 steps of the state filter.

    Args:
        build: `build(theta) -> StateSpaceModel`, a function that JAX can trace.
        theta: the parameters and what is known of them, as for `joint`: `sp.Gaussian` over a vector (independent
            elements), or any pytree of `sp.real`, `sp.positive`, `sp.bounded` and numbers.
        drift: how much parameters may move between samples, any that `learner` takes; `fixed(0)` where not given, and
            a number q is `fixed(q)`. In
            squared units of the vector for `sp.Gaussian`; for a pytree, relative to the squared prior deviations.
        state_method: of the states' filter, any that draws its points anew; `srcdkf()` where not given.
        parameter_method: of the parameters' filter, as for `learner`; `srcdkf()` where not given.
        cost: what is to be small: `prediction_error()`, where not given, or `maximum_likelihood()`.

    Returns:
        A `Dual`: `init`, `update`, `filter`.

    Raises:
        ValueError: no unknown parameters, correlated ones, a `build` that gives no model, a method that is not for
            this, a drift or cost of another kind.

    Source: Wan & Nelson (2001), Table 5.3; Wan & van der Merwe (2001), section 7.5.

    Examples:
        >>> import jax, jax.numpy as jnp, sigmapoint as sp
        >>> def build(a):
        ...     return sp.StateSpaceModel(lambda x, u: a * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                               sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> x, y = sp.simulate(build(0.9), 500, key=jax.random.key(0))
        >>> result = sp.dual(build, sp.bounded(0.5, 0.3, low=-1.0, high=1.0)).filter(y)
        >>> bool(abs(result.theta - 0.9) < 3 * result.estimates.std[-1]), result.post.mean.shape
        (True, (500, 1))
    """
    checks.function("build", build, "theta")
    unknowns = Unknowns.of(theta)
    prior = unknowns.prior
    if checks.known(prior.cov) and np.count_nonzero(prior.cov - np.diag(np.diagonal(prior.cov))):
        raise ValueError("dual: theta must have a diagonal covariance, of independent parameters; sp.joint takes any")
    model = built(build, unknowns.tree(prior.mean))
    state_method = filtering.fitting(model, state_method)
    if not isinstance(state_method.carry, Redraw):
        raise ValueError("dual: the state_method must not be augmented or extended: its points are not remembered")
    cost = prediction_error() if cost is None else cost
    checks.instance("cost", cost, Cost, "sp.prediction_error() or sp.maximum_likelihood()")
    point, directions = model.initial.mean.shape[0], model.initial.cov.shape[0]
    cell = Cell(build, unknowns, state_method, cost, model.state_space, point, directions)
    parameters = Parameters.of(prior.mean, jnp.sqrt(jnp.diagonal(prior.cov)))
    return Dual(cell, parameters, *fitting(parameters, parameter_method, drift, "parameter_method"))
