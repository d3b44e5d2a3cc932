"""Are normalised innovations z white, unbiased, Gaussian, and unrelated to the inputs?

With N values measured and N_l pairs of them l samples apart,

    ρ_l = mean(z_k z_{k+l}) / mean(z_k²)            of centred z; within ±1.96/√N_l for white noise
    Q   = (N + 2)/N Σ_l N_l ρ_l²                    ~ χ²(lags with N_l > 0): Ljung & Box (1978), gaps as in
                                                    Stoffer & Toloi (1992)
    J   = N/6 (skewness² + excess kurtosis²/4)      ~ χ²(2): Jarque & Bera (1980)

The correlation with an input column v is taken with v[k] (it enters h) and v[k-1] (it entered f); its standard
deviation is √(N + 2 Σ_l N_l ρ_l(z) ρ_l(v)) / N, so that two slow series are not taken for related (Bartlett 1946).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from sigmapoint import checks

LAGS = 20
COLUMNS = 32
"""Input columns that are looked at."""


class InputCorrelation(NamedTuple):
    """Correlation of an innovation with one column of the inputs, and the half-width of its 95 % band."""

    column: str
    correlation: float
    band: float


class Element(NamedTuple):
    """What the normalised innovations of one measured quantity show; NaN where there were too few to say."""

    name: str
    white: Float[np.ndarray, "T"]
    """normalised: mean 0, variance 1; NaN where not measured"""
    samples: int
    bias: float
    """mean of the normalised innovations, in standard deviations"""
    autocorrelation: Float[np.ndarray, "L"]
    """at lags 1, 2, …"""
    band: Float[np.ndarray, "L"]
    """95 % of the autocorrelations of white noise are within ± this; infinite at lags that no two values are apart"""
    ljung_box: float
    """p-value of whiteness"""
    skewness: float
    kurtosis: float
    """excess over a Gaussian"""
    jarque_bera: float
    """p-value of normality"""
    inputs: tuple[InputCorrelation, ...]


def autocorrelation(z: Float[np.ndarray, "T"], lags: int) -> tuple[Float[np.ndarray, "L"], Float[np.ndarray, "L"]]:
    """Autocorrelation at lags 1 … `lags` over the pairs that were measured, and the numbers of pairs."""
    valid = np.isfinite(z)
    centred = np.where(valid, z - _mean(z), 0.0)
    variance = (centred**2).sum() / max(valid.sum(), 1)
    pairs = np.array([(valid[:-lag] & valid[lag:]).sum() for lag in range(1, lags + 1)], float)
    sums = np.array([centred[:-lag] @ centred[lag:] for lag in range(1, lags + 1)], float)
    if not _varies(z):
        return np.zeros(lags), pairs
    return sums / (np.maximum(pairs, 1) * variance), pairs


def examined(name: str, z: Float[np.ndarray, "T"], inputs: dict[str, np.ndarray]) -> Element:
    """All tests of the normalised innovations of one quantity."""
    chi2 = checks.extra("scipy.stats", "a test of innovations").chi2
    count = int(np.isfinite(z).sum())
    lags = max(min(LAGS, count // 4, z.size - 1), 0)
    rho, pairs = autocorrelation(z, lags)
    seen = pairs > 0
    Q = (count + 2) / max(count, 1) * float(pairs @ rho**2)
    skewness, kurtosis = _moments(z)
    J = count / 6 * (skewness**2 + kurtosis**2 / 4)
    return Element(
        name=name,
        white=z,
        samples=count,
        bias=_mean(z),
        autocorrelation=rho,
        band=np.where(seen, 1.96 / np.sqrt(np.maximum(pairs, 1)), np.inf),
        ljung_box=float(chi2.sf(Q, seen.sum())) if seen.any() else float("nan"),
        skewness=skewness,
        kurtosis=kurtosis,
        jarque_bera=float(chi2.sf(J, 2)),
        inputs=tuple(_with_input(c, z, v, rho * pairs / count) for c, v in inputs.items() if count > 2 and _varies(v)),
    )


def quantiles(z: Float[np.ndarray, "T"], points: int = 400) -> tuple[Float[np.ndarray, "Q"], Float[np.ndarray, "Q"]]:
    """Quantiles of a standard normal and of `z` (for a QQ plot), at most `points`, evenly spread along the normal."""
    norm = checks.extra("scipy.stats", "a QQ plot").norm
    ordered = np.sort(z[np.isfinite(z)])
    at = norm.ppf((np.arange(ordered.size) + 0.5) / max(ordered.size, 1))
    if ordered.size > points:
        chosen = np.unique(np.searchsorted(at, np.linspace(at[0], at[-1], points)))
        at, ordered = at[chosen], ordered[chosen]
    return at, ordered


def _mean(z: np.ndarray) -> float:
    values = z[np.isfinite(z)]
    return float(values.mean()) if values.size else float("nan")


def _moments(z: np.ndarray) -> tuple[float, float]:
    """Skewness and excess kurtosis; NaN for fewer than 4 values, or when all are alike."""
    values = z[np.isfinite(z)]
    if values.size < 4 or not _varies(values):
        return float("nan"), float("nan")
    s = (values - values.mean()) / values.std()
    return float((s**3).mean()), float((s**4).mean() - 3)


def _varies(values: np.ndarray) -> bool:
    known = values[np.isfinite(values)]
    return known.size > 1 and bool(known.std() > 1e-12 * np.abs(known).max())


def _with_input(column: str, z: np.ndarray, v: np.ndarray, weighed: np.ndarray) -> InputCorrelation:
    """The larger of the correlations with v[k] and v[k-1]; `weighed` is ρ_l(z) N_l / N."""
    past = np.concatenate([[np.nan], v[:-1]])
    correlation = max((_correlation(z, v), _correlation(z, past)), key=abs)
    alike = 1 + 2 * float(weighed @ autocorrelation(v, weighed.size)[0])
    return InputCorrelation(column, correlation, 1.96 * (max(alike, 1.0) / np.isfinite(z).sum()) ** 0.5)


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    both = np.isfinite(a) & np.isfinite(b)
    a, b = a[both], b[both]
    if not (_varies(a) and _varies(b)):
        return 0.0
    return float(np.mean((a - a.mean()) * (b - b.mean())) / (a.std() * b.std()))
