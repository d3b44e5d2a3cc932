"""One unknown parameter: what is known of it, and where it can be.

A parameter that is bound to a range is a monotone function of an unbounded z with a prior of mean 0 and variance 1, so
that quantiles go through it as they are: an interval of z is one of the parameter. Its deviation is half the width of
the central 68 %, that is of what z from -1 to 1 becomes.
"""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint import checks


@runtime_checkable
class Range(Protocol):
    """Where a parameter can be: a monotone function of what is unbounded, and what that is close to a value."""

    def value(self, center: Array, std: Array, z: Array) -> Array:
        """The parameter at `z`: `center` at 0, and `2 std` from z = -1 to 1."""
        ...


@dataclass(frozen=True)
class Real:
    """Anywhere."""

    def value(self, center: Array, std: Array, z: Array) -> Array:
        return center + std * z


@dataclass(frozen=True)
class Positive:
    """Above zero, by the exponential."""

    def value(self, center: Array, std: Array, z: Array) -> Array:
        return center * jnp.exp(jnp.arcsinh(std / center) * z)


@dataclass(frozen=True)
class Bounded:
    """Between two numbers, by the logistic function."""

    low: float
    high: float

    def value(self, center: Array, std: Array, z: Array) -> Array:
        width = self.high - self.low
        part, half = (center - self.low) / width, std / width
        # sigmoid(logit(part) + s) - sigmoid(logit(part) - s) = 2 half is a quadratic equation in the exponential of s.
        a = part / (1 - part)
        b = half * (1 + a**2)
        slope = jnp.log((b + jnp.sqrt(b**2 + a**2 * (1 - 4 * half**2))) / (a * (1 - 2 * half)))
        return self.low + width * jax.nn.sigmoid(jnp.log(a) + slope * z)


class Unknown(eqx.Module):
    """One unknown parameter, of any shape; made by `real`, `positive` or `bounded`."""

    center: Float[Array, "..."]
    std: Float[Array, "..."]
    range: Range = eqx.field(static=True)

    def __repr__(self) -> str:
        if not checks.known(self.center):
            return f"{self.range} of shape {self.center.shape}"
        center, std = (np.array2string(np.asarray(a), precision=6, threshold=10) for a in (self.center, self.std))
        return f"{self.range}: {center} ± {std}"


def real(value: Any, std: Any) -> Unknown:
    """An unknown parameter that may be any number.

    Args:
        value: what it is thought to be, a number or an array, in its own units.
        std: how far off that may be, in the same units: one number, or one for each element.

    Raises:
        ValueError: values that are not finite, a deviation that is not positive.

    Examples:
        >>> import sigmapoint as sp
        >>> float(sp.real(2.0, 0.5).std)
        0.5
    """
    return _unknown(value, std, Real(), -np.inf, np.inf)


def positive(value: Any, std: Any) -> Unknown:
    """An unknown parameter that is greater than zero: its logarithm is Gaussian.

    Args:
        value: what it is thought to be (the median of the prior), a number or an array, in its own units.
        std: how far off that may be, in the same units (half the width of the central 68 %): one number, or one for
            each element. Beyond some thirty times the value, a filter may not find its way: begin with a larger one.

    Raises:
        ValueError: values that are not positive or not finite, a deviation that is not positive.

    Examples:
        >>> import sigmapoint as sp
        >>> float(sp.positive(0.5, 0.1).center)
        0.5
    """
    return _unknown(value, std, Positive(), 0.0, np.inf)


def bounded(value: Any, std: Any, low: float, high: float) -> Unknown:
    """An unknown parameter between two numbers.

    Args:
        value: what it is thought to be (the median of the prior), a number or an array, in its own units.
        std: how far off that may be, in the same units (half the width of the central 68 %): one number, or one for
            each element; less than half of `high - low`.
        low: where it ends.
        high: where it ends.

    Raises:
        ValueError: bounds that are not in order or not finite, values that are not between them, a deviation that is
            not positive or so wide that it leaves no room.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.bounded(0.9, 0.05, low=0.0, high=1.0).range
        Bounded(low=0.0, high=1.0)
    """
    low, high = checks.number("low", low), checks.number("high", high)
    if not -np.inf < low < high < np.inf:
        raise ValueError(f"low and high must be finite, low below high, got {low:g} and {high:g}")
    unknown = _unknown(value, std, Bounded(low, high), low, high)
    if checks.known(unknown.std) and not (np.asarray(unknown.std) < (high - low) / 2).all():
        raise ValueError(
            f"std must be less than {(high - low) / 2:g}, half of high - low, got {np.asarray(unknown.std).tolist()}: "
            "the central 68 % would not fit between the bounds"
        )
    return unknown


def _unknown(value: Any, std: Any, range: Range, low: float, high: float) -> Unknown:
    center = checks.array("value", value)
    std = checks.array("std", std).astype(center.dtype)
    try:
        std = jnp.broadcast_to(std, center.shape)
    except ValueError:
        raise ValueError(f"std of shape {std.shape} does not fit a value of shape {center.shape}") from None
    checks.finite("value", center)
    checks.finite("std", std)
    if checks.known(center) and not ((np.asarray(center) > low) & (np.asarray(center) < high)).all():
        raise ValueError(f"value must be between {low:g} and {high:g}, got {np.asarray(center).tolist()}")
    if checks.known(std) and not (np.asarray(std) > 0).all():
        raise ValueError(f"std must be greater than zero, got {np.asarray(std).tolist()}; what is known is no unknown")
    return Unknown(center, std, range)
