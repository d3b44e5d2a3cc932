"""The two coupled filters of `dual`: one for the states, and one for the parameters that the first is run with."""

import warnings
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from sigmapoint import checks, filtering
from sigmapoint.blackbox import unwrapped
from sigmapoint.breakdown import warned
from sigmapoint.checks import data_checks
from sigmapoint.compiled import series
from sigmapoint.identification.cell import Cell, Sample
from sigmapoint.identification.costs import Seen
from sigmapoint.identification.dual_results import DualHistory, DualResult, DualState, root
from sigmapoint.identification.estimates import Estimates
from sigmapoint.learning.drift import Drift
from sigmapoint.learning.parameters import Parameters
from sigmapoint.learning.state import LearnerState
from sigmapoint.learning.update import Setup, updated
from sigmapoint.linear_algebra.factors import norm_rows
from sigmapoint.methods import Method
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

    def init(self, u: Any = None) -> DualState:
        """The state before the first sample.

        Args:
            u: an input of the shape and type of those to come, for a model that has inputs: the state then has the
                structure of those that follow, as `load` needs it. Its values are of no account.

        Returns:
            The initial belief of the model with the parameters as they are thought to be, and these.

        Raises:
            ValueError: NaN in `u`.

        Examples:
            >>> import jax.numpy as jnp, sigmapoint as sp
            >>> def build(a):
            ...     return sp.StateSpaceModel(lambda x, u: a * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
            ...                               sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
            >>> float(sp.dual(build, sp.real(0.5, 0.25)).init().estimates.std)
            0.25
        """
        return DualState(self.cell, _started(self), self._input(u), jnp.zeros((), int))

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
        u = self._input(u)
        before = u if state.previous is None else state.previous
        learner, info = unwrapped(_updated, self, state.learner, Sample(state.step, y, u, before))
        return DualState(self.cell, learner, u, state.step + 1), info

    def prepare(self, y: Any, u: Any = None) -> DualState:
        """Compile `update` ahead of the first sample.

        Args:
            y: a measurement (m,) of the shape and type of those to come; its values are of no account.
            u: an input of the shape and type of those to come, or nothing.

        Returns:
            The state before the first sample, as `init(u)`.

        Raises:
            ValueError: as `update`.

        Examples:
            >>> import jax.numpy as jnp, numpy as np, sigmapoint as sp
            >>> def build(a):
            ...     return sp.StateSpaceModel(lambda x, u: a * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
            ...                               sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
            >>> int(sp.dual(build, sp.real(0.5, 0.3)).prepare(np.zeros(1)).step)
            0
        """
        state = self.init(u)
        self.update(state, y, u)
        return state

    def _input(self, u: Any) -> Any:
        return jax.tree.map(jnp.asarray, data_checks.inputs(u, None, self.parameters.start.dtype))

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
            ValueError: shapes that do not fit, NaN in `u`, infinite measurements, a state that is none; under
                `jax.jit`, where `update` is at home.

        Examples:
            >>> import jax.numpy as jnp, sigmapoint as sp
            >>> def build(a):
            ...     return sp.StateSpaceModel(lambda x, u: a * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
            ...                               sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
            >>> result = sp.dual(build, sp.real(0.5, 0.3)).filter(jnp.ones((20, 1)), epochs=2)
            >>> result.post.mean.shape, result.estimates.std.shape, result.history.mse.shape
            ((20, 1), (20,), (2,))
        """
        checks.untransformed("Dual.filter", "Dual.update in a jax.lax.scan", self, y, u, state)
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
            warned(Posterior.of(model, y, u, {**kept, "log_likelihood": jnp.sum(kept["log_likelihood"])})),
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
