"""Errors against the truth, where that is known: how large they are, and how many are within their error bars.

A row that is not finite where the truth is known counts: its root-mean-square error is NaN, and no bar covers it.
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from sigmapoint import checks
from sigmapoint.checks import data_checks
from sigmapoint.results import Posterior, field

SIGMAS = (1, 2, 3)
NOMINAL = math.erf(2**0.5)
"""Coverage of ±2σ, of Gaussian errors."""


class Coverage(NamedTuple):
    """Errors of one quantity, in its unit: their root mean square, the largest, and the fraction within 1, 2, 3 σ."""

    name: str
    within: tuple[float, float, float]
    rms: float
    largest: float
    std: float
    """mean of the standard deviations that were stated"""
    samples: int
    mean_square: float
    """of the errors over the standard deviations that were stated; 1 is right"""


class Errors(NamedTuple):
    """Truth minus estimate, the standard deviation that the filter stated, and where the truth is known."""

    names: tuple[str, ...]
    value: Float[np.ndarray, "T n"]
    std: Float[np.ndarray, "T n"]
    known: Bool[np.ndarray, "T n"]

    def each(self) -> tuple[Coverage, ...]:
        """Of every element."""
        columns = zip(self.names, self.value.T, self.std.T, self.known.T)
        return tuple(coverage(name, value[known], std[known]) for name, value, std, known in columns)

    def together(self) -> Coverage:
        """Of all elements as if they were one."""
        return coverage("", self.value[self.known], self.std[self.known])


def errors(post: Posterior, truth: Any) -> Errors:
    """Errors in the model's `state_space`, of the true states (T, n); NaN where they are not known.

    Raises:
        ValueError: a truth of another shape; a batch of results; `mean` or `std` not kept.
    """
    mean, std = field(post, "mean"), field(post, "std")
    truth = data_checks.truth(truth, mean.shape)
    difference = jax.vmap(post.labels.state_space.residual)
    value = np.asarray(difference(jnp.asarray(truth, mean.dtype), jnp.asarray(mean)), float)
    known = ~np.isnan(truth) if value.shape == truth.shape else ~np.isnan(truth).any(1, keepdims=True)
    return Errors(post.labels.directions(value.shape[1]).names, value, std, np.broadcast_to(known, value.shape))


def coverage(name: str, error: Float[np.ndarray, "K"], std: Float[np.ndarray, "K"]) -> Coverage:
    """Of K errors with the standard deviations stated for them; NaN of none."""
    if not error.size:
        nan = float("nan")
        return Coverage(name, (nan, nan, nan), nan, nan, nan, 0, nan)
    size = np.abs(error)
    one, two, three = (float(np.mean(size <= k * std)) for k in SIGMAS)
    rms, relative = float(np.sqrt(np.mean(error**2))), float(np.mean(relative_to(error, std) ** 2))
    return Coverage(name, (one, two, three), rms, float(size.max()), float(std.mean()), size.size, relative)


def relative_to(error: Float[np.ndarray, "*T"], std: Float[np.ndarray, "*T"]) -> Float[np.ndarray, "*T"]:
    """Errors as multiples of what was stated for them; infinite where either is no number, or only the latter is 0."""
    ratio = error / np.where(std > 0, std, np.nan)
    return np.where((error == 0) & (std == 0), 0.0, np.where(np.isnan(ratio), np.inf, ratio))


def chance(c: Coverage, independent: float) -> float:
    """Probability of so few errors within ±2σ, or of so large ones, of Gaussians with the bars that were stated.

    The smaller of the two: binomial, and χ². `independent` is how many of them are (`independent_rows`): by squares,
    which are more correlated than whether errors are within.
    """
    special, share = checks.extra("scipy.special", "a verdict on coverage"), c.within[1]
    few = special.betainc(independent * (1 - share), independent * share + 1, 1 - NOMINAL)
    return float(min(few, special.chdtrc(independent, independent * c.mean_square)))
