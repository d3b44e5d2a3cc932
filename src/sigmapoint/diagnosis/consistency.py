"""Consistency of normalised squares with χ².

If the model is right, an innovation e with its covariance S and an error x − m with its covariance P satisfy

    NIS = eᵀ S⁻¹ e ~ χ²(measured elements),      NEES = (x − m)ᵀ P⁻¹ (x − m) ~ χ²(n)

and the sum over independent rows is χ² of the summed degrees of freedom: Bar-Shalom, Li & Kirubarajan, *Estimation with
Applications to Tracking and Navigation* (2001), §5.4. Means are quoted per degree of freedom, so that 1 is right.

Vectors are normalised by the symmetric root of their correlation matrix, which keeps every normalised element as close
as possible to the element it came from (ZCA-cor: Kessy, Lewin & Strimmer, The American Statistician 72, 2018).
Directions without variance have nothing to be normalised by; they are left out and lower the degrees of freedom.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from sigmapoint import checks

LEVEL = (0.025, 0.975)
WINDOW = 5
"""Correlation times up to which correlations are summed."""
BLOCK = 20_000
"""Rows decomposed at a time, to bound memory."""


class Normalised(NamedTuple):
    """Vectors made standard: `white` (NaN where unknown), their squared lengths, and degrees of freedom."""

    white: Float[np.ndarray, "T d"]
    squared: Float[np.ndarray, "T"]
    degrees: Int[np.ndarray, "T"]


class Consistency(NamedTuple):
    """NIS or NEES of a run, per degree of freedom: 1 is right, above is overconfident, below is underconfident."""

    mean: float
    band: tuple[float, float]
    """95 % of such means; of NEES, by how long errors are correlated"""
    median: float
    """of the rows, as a multiple of its expectation: a mean above with a median below 1 is a few large values"""
    inside: float
    """fraction of rows within their own 95 % band"""
    rows: int
    degrees: int


class Surprise(NamedTuple):
    """How large innovations were by the NIS of a series; NaN where nothing was measured."""

    mean: float
    """of the rows that were measured"""
    expected: float
    """that mean, of a model that is right: how many elements were measured in a row"""
    per_element: float
    """the NIS of all rows over all elements; 1 is right"""
    measured_elements: int


def normalised(error: Float[np.ndarray, "T d"], cov: Float[np.ndarray, "T d d"]) -> Normalised:
    """Divide vectors by the symmetric root of their covariance; NaN elements were not measured."""
    starts = range(0, max(len(error), 1), BLOCK)
    blocks = [_normalised(error[i : i + BLOCK], cov[i : i + BLOCK]) for i in starts]
    return Normalised(*(np.concatenate(parts) for parts in zip(*blocks)))


def _normalised(error: np.ndarray, cov: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    d, tol = error.shape[1], 100 * np.finfo(cov.dtype).eps
    error, cov = error.astype(float), cov.astype(float)
    variance = np.einsum("tii->ti", cov)
    usable = np.isfinite(error) & np.isfinite(variance) & (variance > 0)
    scale = np.sqrt(np.where(usable, variance, 1.0))
    known = usable[:, :, None] & usable[:, None, :] & np.isfinite(cov)
    correlation = np.where(known, cov, 0.0) / scale[:, :, None] / scale[:, None, :]
    correlation = np.where(~usable[:, :, None] & np.eye(d, dtype=bool), 1.0, correlation)
    w, V = np.linalg.eigh(correlation)
    kept = w > tol * d
    along = np.einsum("tij,ti->tj", V, np.where(usable, error, 0.0) / scale)
    along = np.where(kept, along / np.sqrt(np.where(kept, w, 1.0)), 0.0)
    white = np.where(usable, np.einsum("tij,tj->ti", V, along), np.nan)
    return white, (along**2).sum(1), np.maximum(usable.sum(1) - (~kept).sum(1), 0)


def surprise(innovation: Float[np.ndarray, "T m"], nis: Float[np.ndarray, "T"]) -> Surprise:
    """Judge the NIS by the elements that were measured, those whose innovation is not NaN."""
    elements = (~np.isnan(innovation)).sum(1)
    measured, total = elements > 0, int(elements.sum())
    if not total:
        return Surprise(float("nan"), float("nan"), float("nan"), 0)
    nis = nis.astype(float)
    return Surprise(float(nis[measured].mean()), float(elements[measured].mean()), float(nis.sum()) / total, total)


def row_band(degrees: Int[np.ndarray, "T"]) -> tuple[Float[np.ndarray, "T"], Float[np.ndarray, "T"]]:
    """The 95 % band of each row, χ² with its own degrees of freedom; NaN where those are 0."""
    low, high = (_quantile(level, degrees) for level in LEVEL)
    return low, high


def consistency(
    squared: Float[np.ndarray, "T"], degrees: Int[np.ndarray, "T"], independent: float | None = None
) -> Consistency:
    """Judge normalised squares against χ²; rows with no degrees of freedom, or not finite, are left out.

    Where rows are correlated, as errors of a state are, `independent` is how many of them all are worth.
    """
    used = (degrees > 0) & np.isfinite(squared)
    squared, degrees = squared[used].astype(float), degrees[used]
    total = int(degrees.sum())
    if total == 0:
        nan = float("nan")
        return Consistency(nan, (nan, nan), nan, nan, 0, 0)
    low, high = row_band(degrees)
    worth = np.array([total if independent is None else total * independent / len(squared)])
    spread = [float(_quantile(level, worth)[0]) / float(worth[0]) for level in LEVEL]
    return Consistency(
        mean=float(squared.sum() / total),
        band=(spread[0], spread[1]),
        median=float(np.median(squared / _quantile(0.5, degrees))),
        inside=float(np.mean((low <= squared) & (squared <= high))),
        rows=squared.size,
        degrees=total,
    )


def independent_rows(white: Float[np.ndarray, "T d"]) -> float:
    """How many independent rows say as much about the mean of the squares as those that are known, correlated in time.

    This effective sample size is K / (1 + 2 Σ ρₖ²): squares of Gaussian vectors have the squares of their correlations.
    These are taken about zero, so that an offset counts as correlation, over all elements of the K rows of which any is
    finite, one after the other, up to the first lag that is `WINDOW` times the denominator (after Sokal, "Monte Carlo
    methods in statistical mechanics", 1997).

    Examples:
        >>> import numpy as np
        >>> from sigmapoint.diagnosis.consistency import independent_rows
        >>> bool(450 < independent_rows(np.random.default_rng(0).normal(size=(500, 1))) <= 500)
        True
        >>> independent_rows(np.ones((500, 1))) < 2
        True
    """
    known = np.isfinite(white)
    z = np.where(known, white, 0.0)[known.any(1)]
    K = len(z)
    covariance = np.fft.irfft(np.abs(np.fft.rfft(z, 2 * K, axis=0)) ** 2, axis=0)[:K] if K else z
    varying = covariance[:, covariance[0] > 0] if K else z
    if not varying.size:
        return float(K)
    times = 2 * np.cumsum(((varying / varying[0]) ** 2).mean(1)) - 1
    window = np.arange(K) >= WINDOW * times
    return K / float(times[window.argmax() if window.any() else -1])


def _quantile(level: float, degrees: np.ndarray) -> np.ndarray:
    chi2 = checks.extra("scipy.stats", "a χ² band").chi2
    distinct, where = np.unique(degrees, return_inverse=True)
    return np.where(distinct > 0, chi2.ppf(level, np.where(distinct > 0, distinct, 1)), np.nan)[where]
