"""Figures of the report: states, errors, innovations, NIS. Each function returns a `plotly` figure."""

from collections.abc import Callable
from typing import Any

import numpy as np
import plotly.graph_objects as go

from sigmapoint.curves import broken, wraps
from sigmapoint.diagnosis.consistency import row_band
from sigmapoint.plotting import titled
from sigmapoint.reporting import traces
from sigmapoint.reporting.decimate import POINTS, compact, extremes, with_breaks
from sigmapoint.reporting.runs import Run, Runs
from sigmapoint.reporting.traces import REFERENCE

TRUTH = "#e0457b"
FLOOR = 1e-3
"""NIS below this is drawn there: its axis is logarithmic."""


def state_figure(runs: Runs, i: int) -> go.Figure:
    """State `i` of every method with its ±2σ band, and the truth."""
    figure = traces.series(runs.x, runs.axis, titled(runs.labels.states[i], runs.labels.state_units[i]))
    for run in runs.each:
        if run.mean is not None:
            std = run.std[:, i] if run.std is not None and run.std.shape == run.mean.shape else None
            _banded(figure, runs.x, run, run.mean[:, i], std, wraps(runs.labels.state_space, run.mean, i))
    if runs.truth is not None and np.isfinite(runs.truth[:, i]).any():
        breaks = wraps(runs.labels.state_space, runs.truth, i)
        figure.add_trace(
            traces.line(runs.x, runs.truth[:, i], name="truth", color=TRUTH, dash="dash", width=1.4, breaks=breaks)
        )
    return figure


def error_figure(runs: Runs, i: int, name: str, unit: str) -> go.Figure:
    """Truth minus estimate of state `i` against ±2σ."""
    figure = traces.series(runs.x, runs.axis, titled(f"error of {name}", unit))
    for run in runs.each:
        if run.error is not None and run.std is not None:
            _against_band(figure, runs.x, run, run.error[:, i], run.std[:, i])
    return figure


def measurement_figure(runs: Runs, j: int) -> go.Figure:
    """Measurement `j` and what every method expected."""
    figure = traces.series(runs.x, runs.axis, titled(runs.labels.observations[j], runs.labels.observation_units[j]))
    figure.add_trace(traces.dots(runs.x, runs.y[:, j], name="measured", color=REFERENCE))
    for run in runs.each:
        if run.predicted is not None:
            breaks, name = wraps(runs.labels.observation_space, run.predicted, j), run.name or "predicted"
            line = traces.line(
                runs.x, run.predicted[:, j], name=name, color=run.style.color, dash=run.style.dash, breaks=breaks
            )
            figure.add_trace(line)
    return figure


def innovation_figure(runs: Runs, j: int) -> go.Figure:
    """Innovation `j` of every method against ±2σ."""
    name, unit = (part[j] for part in runs.innovations)
    figure = traces.series(runs.x, runs.axis, titled(f"{name} innovation", unit))
    for run in runs.each:
        if run.innovation is not None and run.spread is not None:
            _against_band(figure, runs.x, run, run.innovation[:, j], run.spread[:, j], traces.dots)
    return figure


def nis_figure(runs: Runs) -> go.Figure:
    """NIS of every sample, its running mean, and the χ² band of one sample."""
    figure = traces.series(runs.x, runs.axis, "NIS")
    known = [(run, run.nis, run.degrees) for run in runs.each if run.nis is not None and run.degrees is not None]
    for run, nis, degrees in known:
        nis = np.where(degrees > 0, nis, np.nan)
        if len(known) == 1:
            figure.add_trace(
                traces.dots(runs.x, np.maximum(nis, FLOOR), name="NIS", color=run.style.color, opacity=0.45)
            )
        mean = np.maximum(running_mean(nis), FLOOR)
        name = f"{run.name} running mean" if len(known) > 1 else "running mean"
        color = TRUTH if len(known) == 1 else run.style.color
        figure.add_trace(traces.line(runs.x, mean, name=name, color=color, dash=run.style.dash, width=2))
    if known:
        _chi_squared(figure, runs.x, known[0][2])
    figure.update_yaxes(type="log", tickformat="~g", dtick=1)
    return figure


def running_mean(values: np.ndarray) -> np.ndarray:
    """Mean over a window of a fiftieth of the series, of what is known."""
    half = max(values.size // 100, 2)
    known = np.isfinite(values)
    sums = np.concatenate([[0.0], np.cumsum(np.where(known, values, 0.0))])
    counts = np.concatenate([[0], np.cumsum(known)])
    low = np.maximum(np.arange(values.size) - half, 0)
    high = np.minimum(np.arange(values.size) + half + 1, values.size)
    number = counts[high] - counts[low]
    return np.where(number > 0, (sums[high] - sums[low]) / np.maximum(number, 1), np.nan)


def _chi_squared(figure: go.Figure, x: np.ndarray, degrees: Any) -> None:
    changes = np.flatnonzero(np.diff(degrees)) + 1
    rows = np.unique(np.concatenate([[0], changes - 1, changes, [degrees.size - 1]]))
    rows = rows if rows.size <= POINTS else extremes(degrees.astype(float))
    for edge, label in zip(row_band(degrees[rows]), ("95 % band of one sample", "")):
        line = {"color": REFERENCE, "width": 1.4, "dash": "dot"}
        shown = {"name": label, "legendgroup": "band", "showlegend": bool(label), "hoverinfo": "skip"}
        figure.add_trace(go.Scatter(x=x[rows], y=edge, mode="lines", line=line, **shown))


def _banded(
    figure: go.Figure, x: np.ndarray, run: Run, mean: np.ndarray, std: np.ndarray | None, breaks: np.ndarray
) -> None:
    """A curve with its ±2σ band around it."""
    if std is not None:
        low, high = mean - 2 * std, mean + 2 * std
        figure.add_trace(traces.band(x, low, high, name=run.name, style=run.style, breaks=breaks))
    trace = traces.line(x, mean, name=run.name or "estimate", color=run.style.color, dash=run.style.dash, breaks=breaks)
    trace.update(legendgroup=run.name)
    if std is not None:
        rows, ends = with_breaks(breaks, mean)
        _, width = broken(ends, x[rows], compact(2 * std[rows]))
        trace.update(customdata=width, hovertemplate="%{y:.5g} ± %{customdata:.2g}")
    figure.add_trace(trace)


def _against_band(
    figure: go.Figure,
    x: np.ndarray,
    run: Run,
    values: np.ndarray,
    std: np.ndarray,
    draw: Callable[..., go.Scatter] = traces.line,
) -> None:
    """A curve that should stay within ±2σ around zero."""
    figure.add_trace(traces.band(x, -2 * std, 2 * std, name=run.name, style=run.style))
    figure.add_trace(draw(x, values, name=run.name or "difference", color=run.style.color).update(legendgroup=run.name))
    top = max([_view(values, std)] + [axis.range[1] for axis in figure.select_yaxes() if axis.range])
    figure.update_yaxes(range=[-top, top] if 0 < top < np.inf else None)


def _view(values: np.ndarray, std: np.ndarray) -> float:
    """How far to show at first: the band, and all but the rarest values (at the start they are often far larger)."""
    known = np.abs(values[np.isfinite(values)])
    if not known.size:
        return 0.0
    common = min(float(known.max()), 1.5 * float(np.quantile(known, 0.995)))
    spread = std[np.isfinite(std)]
    return 1.08 * max(common, 3 * float(np.median(spread)) if spread.size else 0.0)
