"""What training gives, and what it says on the way."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from sigmapoint.learning.learner import Learner
from sigmapoint.learning.state import LearnerState, Prediction


class History(NamedTuple):
    """What training looked like, epoch by epoch; every target was predicted before it was learned from."""

    mse: Float[np.ndarray, " E"]
    """mean squared innovation of an element, in squared units of the targets"""
    nis: Float[np.ndarray, " E"]
    """mean normalised innovation squared of an element [1]: about one where noise and drift are right"""
    log_likelihood: Float[np.ndarray, " E"]
    """sum over the epoch of the natural logarithm of the predicted densities"""
    validation: Float[np.ndarray, " E"]
    """mean squared error on the validation set after the epoch; NaN without one"""

    @property
    def epochs(self) -> int:
        """Number of epochs."""
        return len(self.mse)


class Trained(NamedTuple):
    """A trained function; made by `learn`."""

    learner: Learner
    state: LearnerState
    """of the best epoch, where there was a validation set; else of the last"""
    history: History

    @property
    def params(self) -> Any:
        """The parameters, as the pytree that training began with."""
        return self.learner.params(self.state)

    @property
    def std_params(self) -> Any:
        """Their standard deviations, likewise; every epoch counts the data again, and makes them smaller."""
        return self.learner.std_params(self.state)

    def predict(self, x: Any) -> Prediction:
        """As `Learner.predict`, for one input."""
        return self.learner.predict(self.state, x)

    def __str__(self) -> str:
        errors = self.history.validation
        checked = "" if np.isnan(errors).all() else f", {np.nanmin(errors):.4g} in validation"
        last, nis = f"squared error {self.history.mse[-1]:.4g}", self.history.nis[-1]
        trust = f"; NIS {nis:.2g} an element, not 1: error bars are too narrow" if nis > 3 else ""
        return f"{self.state.mean.shape[0]} parameters after {self.history.epochs} epochs: {last}{checked}{trust}"


class Progress(NamedTuple):
    """How far training is; `str` of it is one line."""

    epoch: int
    epochs: int
    done: float
    """part of the whole, 0 to 1"""
    left: float
    """seconds, about"""
    mse: float
    """of the epoch so far"""
    validation: float
    """after the last finished epoch"""

    def __str__(self) -> str:
        checked = "" if np.isnan(self.validation) else f", validation {self.validation:.4g}"
        return (
            f"epoch {self.epoch}/{self.epochs}, {self.done:.0%}, squared error {self.mse:.4g}{checked}, "
            f"{self.left:.0f} s left"
        )
