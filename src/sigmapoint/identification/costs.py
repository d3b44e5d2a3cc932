"""What dual estimation makes small: errors whose half square, −½|e|², is a log-likelihood of the parameters.

With ν the innovation of the state filter at some parameters z, S = C Cᵀ its covariance (C lower triangular, cᵢ its
diagonal), and C̄, c̄ᵢ those at the parameters as they are estimated now:

* prediction error:     e = C̄⁻¹ ν, or e = ν with a noise that is given or learned (Ljung 1979);
* maximum likelihood:   e = (C⁻¹ ν, √(1 + log cᵢ²/c̄ᵢ²)), so that ½|e|² = −log N(ν; 0, S) + what z does not change.

In the second, the estimator's Jᵀ J is on average the Fisher information of what is measured: element i, given those
before it, tells (∂νᵢ/∂z)²/cᵢ² by its mean and ½ (∂ log cᵢ²/∂z)² by its variance, half of it by each part of e. It takes
the 1 under the root for that; and there is no other reference that parameters of the noises would not change, too.

Source: Wan & Nelson, "Dual Extended Kalman Filter Methods", chapter 5 of Haykin (ed.), Kalman Filtering and Neural
Networks (2001), sections 5.4 and 5.5; there with scalar measurements.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from sigmapoint.learning import measurement_noise
from sigmapoint.learning.measurement_noise import Known, MeasurementNoise
from sigmapoint.linear_algebra.factors import cholesky, one_where_zero, solve_lower
from sigmapoint.step import Info

UNIT = Known(1.0)
LEAST = 0.5
"""Where a variance is less than exp(LEAST − 1) of the present one, its error goes on as a straight line."""


class Seen(NamedTuple):
    """An innovation of the state filter, as far as there was a measurement."""

    innovation: Float[Array, " m"]
    """0 where there was none"""
    factor: Float[Array, "m m"]
    """lower factor of its covariance; of the identity where there was none"""
    there: Bool[Array, " m"]

    @classmethod
    def of(cls, info: Info) -> "Seen":
        """From what an update saw."""
        there = ~jnp.isnan(info.innovation)
        S = jnp.where(there[:, None] & there[None, :], info.innovation_cov, 0.0)
        factor = cholesky(S + jnp.diag((~there).astype(S.dtype)))
        return cls(jnp.where(there, info.innovation, 0.0), factor, there)


@runtime_checkable
class Cost(Protocol):
    """Errors that should be zero."""

    @property
    def noise(self) -> MeasurementNoise:
        """What is known of their covariance."""
        ...

    def errors(self, seen: Seen, present: Seen) -> Float[Array, "r m"]:
        """With some parameters, beside the present ones; as many as there are, for each element of an innovation."""
        ...


@dataclass(frozen=True)
class Weighted:
    """ν, by the innovation covariance at the present parameters."""

    noise: MeasurementNoise = UNIT

    def errors(self, seen: Seen, present: Seen) -> Float[Array, "r m"]:
        return -solve_lower(present.factor, seen.innovation)[None]


@dataclass(frozen=True)
class Plain:
    """ν, by a noise of its own."""

    noise: MeasurementNoise

    def errors(self, seen: Seen, present: Seen) -> Float[Array, "r m"]:
        return -seen.innovation[None]


@dataclass(frozen=True)
class Likelihood:
    """ν by its covariance, and that covariance."""

    noise: MeasurementNoise = UNIT

    def errors(self, seen: Seen, present: Seen) -> Float[Array, "r m"]:
        white = solve_lower(seen.factor, seen.innovation)
        grown = _log_variance(seen) - _log_variance(present)
        return jnp.stack([-white, jnp.where(seen.there, _root_of_one_and(grown), 0.0)])


def _log_variance(seen: Seen) -> Float[Array, " m"]:
    return 2 * jnp.log(jnp.abs(one_where_zero(jnp.diagonal(seen.factor))))


def _root_of_one_and(t: Float[Array, " m"]) -> Float[Array, " m"]:
    """√(1 + t), and its tangent at 1 + t = LEAST below that: sigma points may reach where there is no root."""
    root = jnp.sqrt(jnp.maximum(1 + t, LEAST))
    return root + jnp.minimum(1 + t - LEAST, 0.0) / (2 * root)


def prediction_error(noise: Any = None) -> Cost:
    """Parameters that predict measurements best: the default cost of `dual`.

    Args:
        noise: how far measurements are from their predictions even with the right parameters: a variance, one for each
            element, a covariance (m, m), in squared units of the measurement, or `learned_noise(...)`. Where not given,
            the covariance of the innovation that the state filter has with the present parameters, at every instant: it
            is right where the model's noises are, and then parameters have the error bars of `joint`.

    Returns:
        A cost for `dual`.

    Raises:
        ValueError: a variance that is not positive, a covariance that is not symmetric or positive semi-definite.

    Source: Wan & Nelson (2001), section 5.4; the weight as in Ljung, "Asymptotic Behavior of the Extended Kalman Filter
    as a Parameter Estimator for Linear Systems" (1979).

    Examples:
        >>> import sigmapoint as sp
        >>> sp.prediction_error(sp.learned_noise(0.1, rate=0.01)).noise.rate
        0.01
    """
    if noise is None:
        return Weighted()
    known = isinstance(noise, MeasurementNoise)
    return Plain(noise if known else Known(measurement_noise.checked("noise", noise)))


def maximum_likelihood() -> Cost:
    """Parameters that measurements are most likely with, those of the noises included.

    Innovations are weighted by a covariance that depends on the parameters, and that covariance is to be small itself.
    `prediction_error` cannot tell how large a noise is, only how large one is beside another.

    Returns:
        A cost for `dual`.

    Source: Wan & Nelson (2001), section 5.5; for any number of measured elements, and parameters of the noises.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.maximum_likelihood().noise.value
        1.0
    """
    return Likelihood()
