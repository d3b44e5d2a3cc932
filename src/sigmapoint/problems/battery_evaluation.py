"""Judge an estimate of the state of charge: error, coverage of its band, and normalised innovations (NIS).

NIS is χ² with one degree of freedom when the model is right. With 95 % probability one sample then lies between the
squares of the normal quantiles at 0.5125 and 0.9875, and the mean of T independent ones in 1 ± 1.96 √(2/T).
"""

from statistics import NormalDist
from typing import Protocol

import numpy as np
from jaxtyping import Array, Float

from sigmapoint.data import Log

SETTLED = 1800.0
"""Time after which an estimate is judged [s]."""


class Estimate(Protocol):
    """What is read of a filtered run; the first state is the SOC [1]."""

    @property
    def mean(self) -> Float[Array, "T n"]: ...

    @property
    def std(self) -> Float[Array, "T n"]: ...

    @property
    def nis(self) -> Float[Array, "T"]: ...


def evaluate(post: Estimate, log: Log, reference: Float[np.ndarray, "T"]) -> dict[str, float | tuple[float, float]]:
    """Judge an estimate from 30 minutes after its start against the counted charge.

    Args:
        post: filtered run, from `sigmapoint.filter`.
        log: the run.
        reference: [1] SOC from `reference_soc`.

    Returns:
        ``soc_rms`` and ``soc_max`` [SOC points], ``soc_std`` (rms of the filter's own standard deviation, SOC points),
        ``coverage`` [%] of ±2 standard deviations, ``nis_mean`` with ``nis_mean_band`` (95 %, if innovations were
        independent), ``nis_inside`` [%] of samples in the 95 % band of one sample (χ² with one degree of freedom).
    """
    late = log.time - log.time[0] >= SETTLED
    soc, std = np.asarray(post.mean)[late, 0], np.asarray(post.std)[late, 0]
    error, nis = soc - reference[late], np.asarray(post.nis)[late]
    low, high = (NormalDist().inv_cdf((1 + p) / 2) ** 2 for p in (0.025, 0.975))
    spread = NormalDist().inv_cdf(0.975) * (2 / nis.size) ** 0.5
    return {
        "soc_rms": float(100 * np.sqrt(np.mean(error**2))),
        "soc_max": float(100 * np.max(abs(error))),
        "soc_std": float(100 * np.sqrt(np.mean(std**2))),
        "coverage": float(100 * np.mean(abs(error) <= 2 * std)),
        "nis_mean": float(np.mean(nis)),
        "nis_mean_band": (1 - spread, 1 + spread),
        "nis_inside": float(100 * np.mean((nis >= low) & (nis <= high))),
    }
