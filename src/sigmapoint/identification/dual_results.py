"""What the two coupled filters of `dual` know, and what they make of a series."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sigmapoint.contents import Contents, Curve, Panel, Section
from sigmapoint.identification.cell import Cell
from sigmapoint.identification.contents import over_time
from sigmapoint.identification.estimates import Estimates
from sigmapoint.identification.unknowns import built
from sigmapoint.learning.state import LearnerState
from sigmapoint.linear_algebra.factors import norm_rows
from sigmapoint.model import StateSpaceModel
from sigmapoint.plotting import plot_panels
from sigmapoint.results import Posterior
from sigmapoint.tables import instants


def root(cell: Cell, learner: LearnerState) -> Float[Array, "n k"]:
    """Of the state's covariance: that of its filter, and what the parameters leave open."""
    own = cell.belief(learner.memory.mean).factor
    return jnp.concatenate([own, learner.memory.slope[: cell.directions] @ learner.factor], axis=1)


class DualState(eqx.Module):
    """What is known after so many samples: of the state at the instant of the last one, and of the parameters."""

    cell: Cell
    learner: LearnerState
    """of the parameters, as the vector z; its memory is the belief of the state filter"""
    previous: Any
    """the input of the last sample"""
    step: Int[Array, ""]
    """number of samples of the series that were taken in"""

    @property
    def mean(self) -> Float[Array, " d"]:
        """Of the state, in its units."""
        return self.learner.memory.mean[: self.cell.point]

    @property
    def cov(self) -> Float[Array, "n n"]:
        """Covariance of the state, in products of its units, with what the parameters leave open (to first order)."""
        spread = root(self.cell, self.learner)
        return spread @ spread.T

    @property
    def std(self) -> Float[Array, " n"]:
        """Standard deviations of the state's elements, in their units, likewise."""
        return norm_rows(root(self.cell, self.learner))

    @property
    def theta(self) -> Any:
        """The parameters, as the pytree that `build` takes."""
        return self.cell.unknowns.tree(self.learner.mean)

    @property
    def estimates(self) -> Estimates:
        """Value, standard deviation and 95 % interval of the parameters, in their own units."""
        return Estimates.of(self.cell.unknowns, self.learner.mean, self.learner.std)


class DualHistory(NamedTuple):
    """What the epochs looked like; every sample was predicted before anything was learned from it."""

    mse: Float[np.ndarray, " E"]
    """mean squared innovation of a measured element, in squared units of the measurement"""
    log_likelihood: Float[np.ndarray, " E"]
    """natural logarithm of the density of all measurements, by the state filter"""

    def section(self) -> Section:
        """What a page shows of them."""
        epochs = np.arange(1, len(self.mse) + 1)
        drawn = {"Log-likelihood": self.log_likelihood, "Mean squared innovation": self.mse}
        panels = {name: Panel((Curve(y, x=epochs),), "epoch") for name, y in drawn.items()}
        text = "By the filter of the states, which has predicted every sample before anything was learned from it. "
        text += "States and parameters on this page are those of the last epoch; it counts the measurements again."
        return Section("Epochs", text, panels=panels)


class DualResult(NamedTuple):
    """States and parameters over a series, in the last epoch; made by `Dual.filter`."""

    post: Posterior
    """States; innovations, their covariance and NIS by the parameters as they were estimated before the sample."""
    estimates: Estimates
    """Parameters after each sample, in their own units; leaves have a leading axis T."""
    state: DualState
    """at the end, to go on from"""
    history: DualHistory
    """of the epochs"""

    @property
    def theta(self) -> Any:
        """The parameters at the end, as the pytree that `build` takes."""
        return self.state.theta

    @property
    def model(self) -> StateSpaceModel:
        """The model with these parameters."""
        return built(self.state.cell.build, self.theta)

    def contents(self) -> Contents:
        """What a page about it shows: the states, and the parameters over time."""
        parameters = over_time(self.state.cell.unknowns.names, self.estimates)
        epochs = (self.history.section(),) if len(self.history.mse) > 1 else ()
        return Contents({"": self.post}, (parameters, *epochs))

    def plot(self, time: Any = None) -> np.ndarray:
        """Draw each parameter after each sample, with its 95 % band, one below the other; the first 12 of many.

        Args:
            time: instants (T,), for the horizontal axis; 0, 1, 2, … where not given.

        Returns:
            The matplotlib axes, an array with one for each parameter drawn; the states are drawn by `post.plot()`.

        Raises:
            ValueError: `time` of another length.
            ImportError: matplotlib is not installed.
        """
        section = over_time(self.state.cell.unknowns.names, self.estimates)
        return plot_panels(section.panels, instants(time, len(self.post.y)), "sample" if time is None else "time")
