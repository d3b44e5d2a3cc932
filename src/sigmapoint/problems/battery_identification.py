"""Identify a `battery.Cell` for one temperature from runs at other temperatures (regression: `battery_regression`).

Another temperature: log r and the capacity are linear in 1/T (Arrhenius); time constants and OCV curve are shared.

Noise comes from the residual e of the regression alone; no filter is run and nothing is tuned:

* ``table``: the rms of e / OCV'(s), and the SOC over which its autocorrelation falls to 1/e. A curve averaged over m
  runs misses a new run √((m+1)/(m-1)) times more than its own, if runs are exchangeable: it is enlarged by that.
* ``slow``: changes of e within the 1 h rests, where an error of the table stands still.
* ``fast``: changes of e within a second.
* ``gain``: charging takes 1.3 % more charge than comes out, in both runs alike. That is more likely the gain of the
  current sensor than a side reaction, so the counted charge is uncertain by as much.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from sigmapoint.data import Log
from sigmapoint.problems.battery import Cell, soc_change
from sigmapoint.problems.battery_regression import Fit, Run, charge_efficiency, fit, prepare

KNEE = 0.1
"""SOC below which the curve is so steep that e [V] says nothing about the RC pairs."""


def _autocorrelation_length(runs: Sequence[Run], shift: list[Float[np.ndarray, "_"]]) -> float:
    """Change of SOC after which the table error has lost all but 1/e of its correlation."""
    step, lags = 0.002, np.arange(150)
    correlation = np.zeros(lags.size)
    for run, b in zip(runs, shift):
        travelled = np.cumsum(abs(soc_change(run.u["held"], run.u["dt"], run.capacity, run.efficiency)))
        b = np.interp(np.arange(travelled[0], travelled[-1], step), travelled, b)
        correlation += [np.mean(b[: b.size - k] * b[k:]) / np.mean(b**2) / len(runs) for k in lags]
    return step * float(np.argmax(correlation < np.exp(-1)))


def _table_noise(runs: Sequence[Run], fit: Fit) -> dict[str, float]:
    slope = fit.curve.derivative()
    shift = [np.where(run.weight > 0, e, 0) / slope(np.clip(run.soc, 0, 1)) for run, e in zip(runs, fit.residuals)]
    mean_square = np.average(np.concatenate(shift) ** 2, weights=np.concatenate([run.weight**2 for run in runs]))
    new_run = (len(runs) + 1) / (len(runs) - 1)
    return {
        "table_std": float(np.sqrt(new_run * mean_square)),
        "table_length": _autocorrelation_length(runs, shift),
    }


def _pair_noise(runs: Sequence[Run], fit: Fit) -> dict[str, float]:
    """Stationary std of a pair's error: mean square change of e over a time d is 2 σ² (1 - exp(-d/τ))."""
    rounding = Cell._field_defaults["voltage_std"] ** 2
    (tau_fast, tau_slow), changes = fit.tau, np.zeros((2, 2))
    for run, e in zip(runs, fit.residuals):
        valid = (run.weight > 0) & (run.soc > KNEE)
        step, time = run.log.step, run.log.time
        quick = valid[1:] & valid[:-1] & (step[1:] == step[:-1]) & (np.diff(time) < 1.05)
        changes[0] += np.sum(np.diff(e)[quick] ** 2 - 2 * rounding), _forgotten(np.diff(time)[quick], tau_fast)
        bounds = np.flatnonzero(np.diff(step)) + 1
        for rows in np.split(np.arange(step.size), bounds):
            first, last = rows[0], rows[-1]
            if valid[first] and run.log.mode[first] == "REST" and time[last] - time[first] > 3000:
                changes[1] += (e[last] - e[first]) ** 2, _forgotten(time[last] - time[first], tau_slow)
    fast, slow = np.sqrt(changes[:, 0] / changes[:, 1])
    return {"fast_std": float(fast), "slow_std": float(slow)}


def _forgotten(duration: np.ndarray, tau: float) -> float:
    return float(np.sum(-2 * np.expm1(-duration / tau)))


def identify(logs: Sequence[Log], temperature: float) -> Cell:
    """Identify the cell at one temperature from runs at other temperatures.

    Args:
        logs: at least two runs at different temperatures, each with a full charge and a discharge to 3.0 V at 10 A, and
            one at least (not the bundled one at 25 °C) with a discharge to 3.0 V before that, for the efficiency.
        temperature: [°C] where the parameters are wanted.

    Returns:
        The cell's parameters and noise levels at ``temperature``.

    Raises:
        ValueError: if fewer than two temperatures are given.

    Examples:
        >>> from sigmapoint.data import load_leaf
        >>> round(identify([load_leaf(10), load_leaf(40)], temperature=25).capacity, 1)
        30.5
    """
    measured = [log.temperature for log in logs]
    if len(set(measured)) < 2:
        raise ValueError(f"logs: need runs at two or more temperatures, got {measured} °C")
    efficiency = float(np.nanmean([charge_efficiency(log) for log in logs]))
    runs = [prepare(log, efficiency) for log in logs]
    solved = fit(runs)

    inverse = 1 / (np.array(measured) + 273.15)
    line = np.vander(inverse, 2)
    at = np.array([1 / (temperature + 273.15), 1.0])
    log_r, *_ = np.linalg.lstsq(line, np.log(solved.resistances.T))
    capacity, *_ = np.linalg.lstsq(line, np.array([run.capacity for run in runs]))
    r0, r_fast, r_slow = (float(r) for r in np.exp(at @ log_r))
    return Cell(
        capacity=float(at @ capacity),
        efficiency=efficiency,
        knots=solved.curve.x,
        pieces=solved.curve.c,
        r0=r0,
        r_fast=r_fast,
        r_slow=r_slow,
        tau_fast=float(solved.tau[0]),
        tau_slow=float(solved.tau[1]),
        gain_std=abs(1 - efficiency),
        **_table_noise(runs, solved),
        **_pair_noise(runs, solved),
    )
