"""OCV curve and resistances of a cell: one linear least-squares problem inside a search for the time constants.

    y = B(s) c + r0 i + r_fast z(i; τ_fast) + r_slow z(i; τ_slow) + e      z⁺ = a z + (1 - a) held, a = exp(-dt / τ)

B are cubic B-splines in SOC with one coefficient vector c for all runs; each run has its own three resistances. Given
the two time constants this is linear, so only those are searched (variable projection: Golub & Pereyra, SIAM J. Numer.
Anal. 10 (1973) 413). Increasing c makes an increasing curve (bounded least squares); each row counts by its duration.

Charge: in each run SOC goes from 1 (end of the full charge) to 0 (3.0 V at 10 A), which defines its own capacity.
Between two 3.0 V cut-offs what went in came out: their ratio is the efficiency.
"""

from collections.abc import Sequence
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.interpolate import BSpline, PPoly
from scipy.optimize import lsq_linear, minimize

from sigmapoint.data import Log
from sigmapoint.problems.battery import FULL_CHARGE, inputs, reference_soc

KNOTS = np.concatenate([np.arange(0.0, 0.15, 0.025), np.linspace(0.15, 1.0, 12)])
"""SOC of the knots: closer below 15 %, where the curve bends."""
SMOOTHING = 0.03
"""Weight on the second differences of c [√s per unit]: damps ripples where the data are thin."""
MIN_SLOPE = 0.05
"""Least slope of the curve [V per unit SOC]."""
TAU_GUESS = np.array([60.0, 1700.0])


class Run(NamedTuple):
    """One run, prepared for the regression."""

    log: Log
    u: dict[str, Float[np.ndarray, "T"]]
    efficiency: float
    capacity: float
    soc: Float[np.ndarray, "T"]
    weight: Float[np.ndarray, "T"]
    basis: Float[np.ndarray, "T m"]


class Fit(NamedTuple):
    """Solution of the regression; ``resistances`` has rows r0, r_fast, r_slow and one column a run."""

    tau: Float[np.ndarray, "2"]
    curve: PPoly
    resistances: Float[np.ndarray, "3 runs"]
    residuals: list[Float[np.ndarray, "_"]]


def charge_efficiency(log: Log) -> float:
    """Charge out over charge in, from the 3.0 V cut-off before the full charge to the one at the end.

    NaN where the log starts later than that cut-off.
    """
    u, first = inputs(log), int(np.flatnonzero(log.step == FULL_CHARGE)[0])
    if not first:
        return np.nan
    moved = (u["held"] * u["dt"])[first - 1 :]
    return float(-moved[moved < 0].sum() / moved[moved > 0].sum())


def _extended(knots: Float[np.ndarray, "K"]) -> Float[np.ndarray, "K+6"]:
    left, right, outside = knots[1] - knots[0], knots[-1] - knots[-2], np.arange(1, 4)
    return np.concatenate([knots[0] - left * outside[::-1], knots, knots[-1] + right * outside])


def prepare(log: Log, efficiency: float) -> Run:
    """Count the charge of a run and lay out its rows."""
    u, first = inputs(log), int(np.flatnonzero(log.step == FULL_CHARGE)[0])
    capacity = float(1 - reference_soc(log, 1.0, efficiency)[-1])
    soc = reference_soc(log, capacity, efficiency)
    weight = np.sqrt(np.maximum(u["dt"], 0.1))
    weight[: max(first - 1, 0)] = 0.0  # the cell's history before the log is unknown
    basis = BSpline.design_matrix(np.clip(soc, KNOTS[0], np.nextafter(KNOTS[-1], 0)), _extended(KNOTS), 3).toarray()
    return Run(log, u, efficiency, capacity, soc, weight, basis)


def _low_pass(u: dict[str, Float[np.ndarray, "T"]], tau: float) -> Float[np.ndarray, "T"]:
    decay = np.exp(-u["dt"] / tau)
    steps = zip(decay[:-1].tolist(), ((1 - decay) * u["held"])[:-1].tolist())
    return np.fromiter(accumulate(steps, lambda z, step: step[0] * z + step[1], initial=0.0), float)


def _drives(run: Run, tau: Float[np.ndarray, "2"]) -> Float[np.ndarray, "3 T"]:
    return np.stack([run.u["current"], *(_low_pass(run.u, t) for t in tau)])


def _compressed(runs: Sequence[Run], tau: Float[np.ndarray, "2"]) -> Float[np.ndarray, "n+1 n+1"]:
    """Triangle R of [A y] = Q R; unknowns: first coefficient and increments of the curve, then r0, r_fast, r_slow.

    27 000 rows, 27 columns. By way of AᵀA and `einsum`, not LAPACK: on a busy machine the threads of a BLAS wait for
    one another at every column, which took 20 s in place of 1 s.
    """
    m, count = runs[0].basis.shape[1], len(runs)
    slopes = np.diff(np.eye(m), axis=0) / np.diff(_centres())[:, None]
    smooth = np.zeros((m + 3 * count + 1, m - 2))
    smooth[:m] = _cumulated(SMOOTHING * np.diff(slopes, axis=0)).T
    gram = np.einsum("ik,jk->ij", smooth, smooth)
    for j, run in enumerate(runs):
        drives = np.zeros((3, count, run.soc.size))
        drives[:, j] = _drives(run, tau)
        columns = np.vstack([_cumulated(run.basis).T, drives.reshape(3 * count, -1), run.log.voltage]) * run.weight
        gram += np.einsum("ik,jk->ij", columns, columns)
    return np.linalg.cholesky(gram, upper=True)


def _cumulated(basis: Float[np.ndarray, "r m"]) -> Float[np.ndarray, "r m"]:
    """The basis for a curve given by its first coefficient and the increments to the next ones."""
    return np.cumsum(basis[:, ::-1], axis=1)[:, ::-1]


def _centres() -> Float[np.ndarray, "m"]:
    """Greville abscissae: where each spline coefficient belongs on the SOC axis."""
    knots = _extended(KNOTS)
    return np.convolve(knots, np.full(3, 1 / 3), mode="valid")[1:-1]


def _misfit(log_tau: Float[np.ndarray, "2"], runs: Sequence[Run]) -> float:
    return float(_compressed(runs, np.exp(log_tau))[-1, -1])


def fit(runs: Sequence[Run]) -> Fit:
    """Solve the regression of the module for all runs together."""
    found = minimize(
        _misfit, np.log(TAU_GUESS), args=(runs,), method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-4}
    )
    tau = np.exp(found.x)
    triangle = _compressed(runs, tau)
    centres = _centres()
    lower = np.concatenate([[-np.inf], MIN_SLOPE * np.diff(centres), np.full(3 * len(runs), 1e-5)])
    solution = lsq_linear(triangle[:-1, :-1], triangle[:-1, -1], (lower, np.inf), method="bvls").x
    pieces = PPoly.from_spline((_extended(KNOTS), np.cumsum(solution[: centres.size]), 3))
    resistances = solution[centres.size :].reshape(3, len(runs))
    residuals = [
        run.log.voltage - pieces(run.soc) - np.einsum("ik,i->k", _drives(run, tau), r)
        for run, r in zip(runs, resistances.T)
    ]
    return Fit(tau, PPoly(pieces.c[:, 3:-3], KNOTS), resistances, residuals)
