"""OCV curve and resistances of a cell: one linear least-squares problem inside a search for the time constants.

    y = B(s) c + r0 i + r_fast z(i; τ_fast) + r_slow z(i; τ_slow) + e      z⁺ = a z + (1 - a) held, a = exp(-dt / τ)

B are cubic B-splines in SOC with one coefficient vector c for all runs; each run has its own three resistances. Given
the two time constants this is linear, so only those are searched (variable projection: Golub & Pereyra, SIAM J. Numer.
Anal. 10 (1973) 413). Increasing c makes an increasing curve (bounded least squares); each row counts by its duration.

Charge: in each run SOC goes from 1 (end of the full charge) to 0 (3.0 V at 10 A), which defines its own capacity.
Between two 3.0 V cut-offs what went in came out: their ratio is the efficiency.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.interpolate import BSpline, PPoly
from scipy.optimize import least_squares, lsq_linear

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
    """Charge out over charge in, from the 3.0 V cut-off before the full charge to the one at the end."""
    u, first = inputs(log), int(np.flatnonzero(log.step == FULL_CHARGE)[0])
    moved = (u["held"] * u["dt"])[first - 1 :]
    return float(-moved[moved < 0].sum() / moved[moved > 0].sum())


def _extended(knots: Float[np.ndarray, "K"]) -> Float[np.ndarray, "K+6"]:
    left, right, outside = knots[1] - knots[0], knots[-1] - knots[-2], np.arange(1, 4)
    return np.concatenate([knots[0] - left * outside[::-1], knots, knots[-1] + right * outside])


def prepare(log: Log, efficiency: float) -> Run:
    u, first = inputs(log), int(np.flatnonzero(log.step == FULL_CHARGE)[0])
    capacity = float(1 - reference_soc(log, 1.0, efficiency)[-1])
    soc = reference_soc(log, capacity, efficiency)
    weight = np.sqrt(np.maximum(u["dt"], 0.1))
    weight[: first - 1] = 0.0  # the cell's history before the log is unknown
    basis = BSpline.design_matrix(np.clip(soc, KNOTS[0], np.nextafter(KNOTS[-1], 0)), _extended(KNOTS), 3).toarray()
    return Run(log, u, efficiency, capacity, soc, weight, basis)


def _low_pass(u: dict[str, Float[np.ndarray, "T"]], tau: float) -> Float[np.ndarray, "T"]:
    decay, z = np.exp(-u["dt"] / tau), np.zeros_like(u["dt"])
    for k in range(z.size - 1):
        z[k + 1] = decay[k] * z[k] + (1 - decay[k]) * u["held"][k]
    return z


def _regression(runs: Sequence[Run], tau: Float[np.ndarray, "2"]) -> tuple[np.ndarray, np.ndarray]:
    """Weighted A, y; unknowns: first coefficient and increments of the curve, then r0, r_fast, r_slow run by run."""
    m = runs[0].basis.shape[1]
    cumulate = np.tril(np.ones((m, m)))
    rows = []
    for j, run in enumerate(runs):
        drives = np.zeros((run.soc.size, 3, len(runs)))
        drives[:, :, j] = np.stack([run.u["current"], *(_low_pass(run.u, t) for t in tau)], axis=1)
        design = np.hstack([run.basis @ cumulate, drives.reshape(run.soc.size, -1)])
        rows.append(run.weight[:, None] * design)
    slopes = np.diff(np.eye(m), axis=0) / np.diff(_centres())[:, None]
    rows.append(np.hstack([SMOOTHING * np.diff(slopes, axis=0) @ cumulate, np.zeros((m - 2, 3 * len(runs)))]))
    y = np.concatenate([*(run.weight * run.log.voltage for run in runs), np.zeros(m - 2)])
    return np.vstack(rows), y


def _centres() -> Float[np.ndarray, "m"]:
    """Greville abscissae: where each spline coefficient belongs on the SOC axis."""
    knots = _extended(KNOTS)
    return np.convolve(knots, np.full(3, 1 / 3), mode="valid")[1:-1]


def _misfit(log_tau: Float[np.ndarray, "2"], runs: Sequence[Run]) -> Float[np.ndarray, "_"]:
    a, y = _regression(runs, np.exp(log_tau))
    q, _ = np.linalg.qr(a)
    return y - q @ (q.T @ y)


def fit(runs: Sequence[Run]) -> Fit:
    tau = np.exp(least_squares(_misfit, np.log(TAU_GUESS), method="lm", diff_step=1e-3, args=(runs,)).x)
    a, y = _regression(runs, tau)
    m, n = runs[0].basis.shape[1], a.shape[1]
    lower = np.concatenate([[-np.inf], MIN_SLOPE * np.diff(_centres()), np.full(n - m, 1e-5)])
    q, r = np.linalg.qr(a)
    solution = lsq_linear(r, q.T @ y, (lower, np.inf), method="bvls").x
    knots = _extended(KNOTS)
    pieces = PPoly.from_spline((knots, np.cumsum(solution[:m]), 3))
    resistances = solution[m:].reshape(3, len(runs))
    residuals = []
    for run, r in zip(runs, resistances.T):
        drives = np.stack([run.u["current"], *(_low_pass(run.u, t) for t in tau)], axis=1)
        residuals.append(run.log.voltage - pieces(run.soc) - drives @ r)
    return Fit(tau, PPoly(pieces.c[:, 3:-3], KNOTS), resistances, residuals)
