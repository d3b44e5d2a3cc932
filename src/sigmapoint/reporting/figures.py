"""Figures of the report: states, errors, innovations, NIS. Each function returns a `plotly` figure.

Colours of the ground, of text and of grids are set by the page, which knows whether it is light or dark.
"""

from typing import Any

import numpy as np
import plotly.graph_objects as go

from sigmapoint.consistency import row_band
from sigmapoint.curves import broken, wraps
from sigmapoint.plotting import titled
from sigmapoint.reporting.decimate import POINTS, compact, extremes, with_breaks
from sigmapoint.reporting.runs import Run, Runs

TRUTH, MEASURED = "#e0457b", "#8b95a5"
NOWHERE = np.zeros(0, int)
"""No breaks."""
FLOOR = 1e-3
"""NIS below this is drawn there: its axis is logarithmic."""


def state_figure(runs: Runs, i: int) -> go.Figure:
    """State `i` of every method with its ±2σ band, and the truth."""
    figure = _series(runs, titled(runs.labels.states[i], runs.labels.state_units[i]))
    for run in runs.each:
        if run.mean is not None:
            std = run.std[:, i] if run.std is not None and run.std.shape == run.mean.shape else None
            _banded(figure, runs.x, run, run.mean[:, i], std, wraps(runs.labels.state_space, run.mean, i))
    if runs.truth is not None and np.isfinite(runs.truth[:, i]).any():
        breaks = wraps(runs.labels.state_space, runs.truth, i)
        figure.add_trace(
            _line(runs.x, runs.truth[:, i], name="truth", color=TRUTH, dash="dash", width=1.4, breaks=breaks)
        )
    return figure


def error_figure(runs: Runs, i: int, name: str, unit: str) -> go.Figure:
    """Truth minus estimate of state `i` against ±2σ."""
    figure = _series(runs, titled(f"error of {name}", unit))
    for run in runs.each:
        if run.error is not None and run.std is not None:
            _against_band(figure, runs.x, run, run.error[:, i], run.std[:, i])
    return figure


def measurement_figure(runs: Runs, j: int) -> go.Figure:
    """Measurement `j` and what every method expected."""
    figure = _series(runs, titled(runs.labels.observations[j], runs.labels.observation_units[j]))
    figure.add_trace(_dots(runs.x, runs.y[:, j], name="measured", color=MEASURED))
    for run in runs.each:
        if run.predicted is not None:
            breaks, name = wraps(runs.labels.observation_space, run.predicted, j), run.name or "predicted"
            line = _line(runs.x, run.predicted[:, j], name=name, color=run.color, dash=run.dash, breaks=breaks)
            figure.add_trace(line)
    return figure


def innovation_figure(runs: Runs, j: int) -> go.Figure:
    """Innovation `j` of every method against ±2σ."""
    name, unit = (part[j] for part in runs.innovations)
    figure = _series(runs, titled(f"{name} innovation", unit))
    for run in runs.each:
        if run.innovation is not None and run.spread is not None:
            _against_band(figure, runs.x, run, run.innovation[:, j], run.spread[:, j], dots=True)
    return figure


def nis_figure(runs: Runs) -> go.Figure:
    """NIS of every sample, its running mean, and the χ² band of one sample."""
    figure = _series(runs, "NIS")
    known = [(run, run.nis, run.degrees) for run in runs.each if run.nis is not None and run.degrees is not None]
    for run, nis, degrees in known:
        nis = np.where(degrees > 0, nis, np.nan)
        if len(known) == 1:
            figure.add_trace(_dots(runs.x, np.maximum(nis, FLOOR), name="NIS", color=run.color, opacity=0.45))
        mean = np.maximum(running_mean(nis), FLOOR)
        name = f"{run.name} running mean" if len(known) > 1 else "running mean"
        color = TRUTH if len(known) == 1 else run.color
        figure.add_trace(_line(runs.x, mean, name=name, color=color, dash=run.dash, width=2))
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
        line = {"color": MEASURED, "width": 1.4, "dash": "dot"}
        shown = {"name": label, "legendgroup": "band", "showlegend": bool(label), "hoverinfo": "skip"}
        figure.add_trace(go.Scatter(x=x[rows], y=edge, mode="lines", line=line, **shown))


def _banded(
    figure: go.Figure, x: np.ndarray, run: Run, mean: np.ndarray, std: np.ndarray | None, breaks: np.ndarray
) -> None:
    """A curve with its ±2σ band around it."""
    if std is not None:
        _band(figure, x, run, mean - 2 * std, mean + 2 * std, breaks)
    trace = _line(x, mean, name=run.name or "estimate", color=run.color, dash=run.dash, breaks=breaks)
    trace.update(legendgroup=run.name)
    if std is not None:
        rows, ends = with_breaks(breaks, mean)
        _, width = broken(ends, x[rows], compact(2 * std[rows]))
        trace.update(customdata=width, hovertemplate="%{y:.5g} ± %{customdata:.2g}")
    figure.add_trace(trace)


def _against_band(
    figure: go.Figure, x: np.ndarray, run: Run, values: np.ndarray, std: np.ndarray, dots: bool = False
) -> None:
    """A curve that should stay within ±2σ around zero."""
    _band(figure, x, run, -2 * std, 2 * std)
    draw = _dots if dots else _line
    figure.add_trace(draw(x, values, name=run.name or "difference", color=run.color).update(legendgroup=run.name))
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


def _band(
    figure: go.Figure, x: np.ndarray, run: Run, low: np.ndarray, high: np.ndarray, breaks: np.ndarray = NOWHERE
) -> None:
    """Closed outlines one after the other with NaN between: one, and one more for every break."""
    rows, ends = with_breaks(breaks, low, high)
    known = [part[np.isfinite(low[part]) & np.isfinite(high[part])] for part in np.split(rows, ends)]
    parts = [part for part in known if part.size] or [rows[:0]]
    outline = np.concatenate([side for part in parts for side in (low[part], high[part][::-1])])
    around = np.concatenate([side for part in parts for side in (part, part[::-1])])
    starts = np.cumsum([2 * part.size for part in parts])[:-1]
    at, outline = broken(starts, x[around], compact(outline))
    trace = go.Scatter(x=at, y=outline, fill="toself", mode="lines")
    trace.update(fillcolor=run.fill, line={"width": 0}, hoverinfo="skip")
    figure.add_trace(trace.update(name=f"{run.name} ±2σ".strip(), legendgroup=run.name, showlegend=False))


def _line(
    x: np.ndarray,
    y: np.ndarray,
    *,
    name: str,
    color: str,
    dash: str = "solid",
    width: float = 1.6,
    breaks: np.ndarray = NOWHERE,
) -> go.Scatter:
    rows, ends = with_breaks(breaks, y)
    at, curve = broken(ends, x[rows], compact(y[rows]))
    # A line needs two neighbours: what stands alone between gaps, as of a slow sensor, is seen as markers only.
    mode = "lines+markers" if _alone(curve).any() else "lines"
    shown = {"line": {"color": color, "width": width, "dash": dash}, "marker": {"color": color, "size": 4}}
    return go.Scatter(x=at, y=curve, name=name, mode=mode, hovertemplate="%{y:.5g}", **shown)


def _alone(curve: np.ndarray) -> np.ndarray:
    known = np.concatenate([[False], np.isfinite(curve), [False]])
    return known[1:-1] & ~known[:-2] & ~known[2:]


def _dots(x: np.ndarray, y: np.ndarray, *, name: str, color: str, opacity: float = 0.7) -> go.Scatter:
    known = np.flatnonzero(np.isfinite(y))
    rows = known[extremes(y[known])] if known.size else known
    marker = {"color": color, "size": 3.5 if rows.size > 500 else 5, "opacity": opacity}
    return go.Scatter(x=x[rows], y=compact(y[rows]), name=name, mode="markers", marker=marker, hovertemplate="%{y:.5g}")


def _series(runs: Runs, title: str) -> go.Figure:
    figure = go.Figure(layout={"template": "none"})
    figure.update_layout(hovermode="x unified", meta={"series": True})
    ends = [runs.x.min(), runs.x.max()] if len(runs.x) > 1 else None
    figure.update_xaxes(title_text=runs.axis, range=ends)
    if runs.x.dtype.kind in "iuf":
        figure.update_xaxes(exponentformat="none", separatethousands=True, hoverformat=",.8~g")
    figure.update_yaxes(title_text=title)
    return figure
