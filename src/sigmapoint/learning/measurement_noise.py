"""How far targets are from predictions, besides what parameters explain."""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.belief import symmetric
from sigmapoint.checks import belief_checks

LEAST = 1e-8
"""A variance is not learned to be less than this part of what it started with: from zero it could not grow again."""


@runtime_checkable
class MeasurementNoise(Protocol):
    """What is known of the covariance of a target: a variance for all elements, one for each, or a matrix."""

    @property
    def value(self) -> Any:
        """What it starts with, nested tuples."""
        ...

    def after(self, value: Array, found: Float[Array, "m m"]) -> Array:
        """What it is after a sample that, alone, would have it `found`."""
        ...


@dataclass(frozen=True)
class Known:
    """The same for ever."""

    value: Any

    def after(self, value: Array, found: Float[Array, "m m"]) -> Array:
        return value


@dataclass(frozen=True)
class Learned:
    """R ← (1 − rate) R + rate · (what R is expected to be, given the sample)."""

    value: Any
    rate: float

    def after(self, value: Array, found: Float[Array, "m m"]) -> Array:
        alike = {0: lambda: jnp.mean(jnp.diagonal(found)), 1: lambda: jnp.diagonal(found), 2: lambda: symmetric(found)}
        mixed = (1 - self.rate) * value + self.rate * alike[value.ndim]()
        least = LEAST * jnp.asarray(self.value, value.dtype)
        if value.ndim < 2:
            return jnp.maximum(mixed, least)
        return mixed + jnp.diag(jnp.maximum(jnp.diagonal(least) - jnp.diagonal(mixed), 0.0))


def covariance(value: Array, size: int) -> Float[Array, "m m"]:
    """The covariance of a target with `size` elements."""
    if value.ndim and value.shape[0] != size:
        raise ValueError(f"noise has shape {value.shape}, but a target has {size} element{'s' * (size > 1)}")
    return value if value.ndim == 2 else jnp.diag(jnp.broadcast_to(value, (size,)))


def expected(
    noise: Float[Array, "M M"], white: Float[Array, " M"], filtered: Float[Array, "M M"]
) -> Float[Array, "M M"]:
    """E[v vᵀ] given the measurement: R + R G⁻¹ (e eᵀ − G) G⁻¹ R with G the covariance of the innovation e.

    On average it is R where R is right: the step of expectation-maximisation. A sum of squares, as
    R − R G⁻¹ R is the covariance of what is left to know about v.

    Args:
        noise: R.
        white: the innovation with unit covariance, C⁻¹ e with C Cᵀ = G.
        filtered: C⁻¹ R.
    """
    mean = filtered.T @ white
    return noise - filtered.T @ filtered + jnp.outer(mean, mean)


def learned_noise(initial: Any, rate: float) -> MeasurementNoise:
    """Measurement noise that is learned along with the parameters, by stochastic approximation.

    The papers average squared innovations (Wan & van der Merwe 2001, section 7.4.1: "a similar update may also be used
    for R"), which the uncertainty of the parameters adds to. Here it is what they are expected to be without it.

    Args:
        initial: what to start with, in squared units of the targets: one variance for all elements of a target, one for
            each, or a covariance (m, m). The same is learned.
        rate: how much of each update enters, in (0, 1]; about 1 / (updates to average over).

    Raises:
        ValueError: a variance that is not positive, a covariance that is not symmetric or positive semi-definite, a
            rate outside (0, 1].

    Examples:
        >>> import sigmapoint as sp
        >>> sp.learned_noise(0.1, rate=0.01).rate
        0.01
    """
    return Learned(checked("initial", initial), checks.fraction("rate", rate))


def checked(name: str, noise: Any) -> Any:
    """A covariance as `covariance` takes it, in nested tuples."""
    with jax.ensure_compile_time_eval():  # it may be called where a program is compiled
        given = checks.array(name, noise)
        if given.ndim > 2:
            raise ValueError(
                f"{name} must be a variance, variances (m,), or a covariance (m, m), got shape {given.shape}"
            )
        if given.ndim == 2:
            belief_checks.covariance(name, given)
        given = np.asarray(given)
        variances = np.diagonal(given) if given.ndim == 2 else given
        if not (np.isfinite(variances) & (variances > 0)).all():
            raise ValueError(f"{name}: the variance of a target must be finite and greater than zero")
    return _tuples(given.tolist())


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
