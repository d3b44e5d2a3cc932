"""What a learner knows and tells."""

from typing import Any, NamedTuple

from jaxtyping import Array, Float, Int

from sigmapoint.learning.uncertainty import Uncertainty
from sigmapoint.linear_algebra.factors import safe_sqrt


class Memory(NamedTuple):
    """What a function remembers, to first order in the parameters: `mean + slope (w − state.mean)`, in its space."""

    mean: Float[Array, "*many H"]
    slope: Float[Array, "*many D L"]


class LearnerState(NamedTuple):
    """What is known about the parameters, all of them in one vector, after so many updates."""

    mean: Float[Array, "*many L"]
    uncertainty: Uncertainty
    drift: Any
    noise: Array
    """of targets: a variance, variances (m,), or a covariance (m, m), in their squared units"""
    memory: Memory
    """of a recurrent function; empty for any other"""
    step: Int[Array, "*many"]

    @property
    def std(self) -> Float[Array, "*many L"]:
        """Standard deviations, in the units of the parameters."""
        return safe_sqrt(self.uncertainty.variance)

    @property
    def cov(self) -> Float[Array, "*many L L"]:
        """Their covariance."""
        return self.uncertainty.cov

    @property
    def factor(self) -> Float[Array, "*many L L"]:
        """A lower factor of their covariance."""
        return self.uncertainty.factor


class LearnerInfo(NamedTuple):
    """What a target looked like before it was learned from."""

    prediction: Float[Array, " M"]
    """in the units of the targets, all of a batch one after the other; of a residual, its value"""
    innovation: Float[Array, " M"]
    """target minus prediction; NaN where there was none"""
    nis: Float[Array, ""]
    """Normalised innovation squared [1], over the elements there were: their number on average if all is right."""
    log_likelihood: Float[Array, ""]
    """Natural logarithm of the predicted density of the target."""


class Prediction(NamedTuple):
    """A function's value with what the parameters leave open."""

    mean: Array
    """in the units of the targets"""
    std: Array
    """standard deviation by the parameters alone, without the noise of targets"""
