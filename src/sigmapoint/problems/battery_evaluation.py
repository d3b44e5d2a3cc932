"""Judge an estimate of the state of charge: error, coverage of its band, and normalised innovations (NIS).

One element is measured, so the NIS is χ² with one degree of freedom when the model is right.
"""

from typing import Protocol

import numpy as np
from jaxtyping import Array, Float

from sigmapoint.data import Log
from sigmapoint.diagnosis.accuracy import coverage
from sigmapoint.diagnosis.consistency import consistency

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
        ``soc_rms_points`` and ``soc_max_points`` [SOC points], ``soc_std_points`` (rms of the filter's own standard
        deviation, SOC points), ``coverage_percent`` [%] of ±2 standard deviations, ``nis_mean`` with ``nis_mean_band``
        (95 %, if innovations were independent), ``nis_inside_percent`` [%] of samples in the 95 % band of one sample
        (χ² with one degree of freedom).
    """
    late = log.time - log.time[0] >= SETTLED
    soc, std = np.asarray(post.mean)[late, 0], np.asarray(post.std)[late, 0]
    error, nis = coverage("soc", soc - reference[late], std), np.asarray(post.nis)[late]
    judged = consistency(nis, np.ones(nis.shape, int))
    return {
        "soc_rms_points": 100 * error.rms,
        "soc_max_points": 100 * error.largest,
        "soc_std_points": float(100 * np.sqrt(np.mean(std**2))),
        "coverage_percent": 100 * error.within[1],
        "nis_mean": judged.mean,
        "nis_mean_band": judged.band,
        "nis_inside_percent": 100 * judged.inside,
    }
