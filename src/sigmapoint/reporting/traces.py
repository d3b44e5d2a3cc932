"""Pieces of figures: axes, lines, dots and bands, each with few enough points to be drawn.

Colours of the ground, of text and of grids are set by the page, which knows whether it is light or dark.
"""

from typing import NamedTuple

import numpy as np
import plotly.graph_objects as go

from sigmapoint.curves import broken
from sigmapoint.reporting.decimate import compact, extremes, with_breaks

COLORS = ("#2f81f7", "#f08a24", "#1fa97a", "#b068e8", "#e5534b", "#12a5b8", "#c9a227", "#8d99ae")
"""Readable on light and dark ground."""
DASHES = ("solid", "dash", "dot", "dashdot")
"""One for each round of the colours, and never colour alone for neighbours of the same round."""
REFERENCE = "#8b95a5"
"""Of what is drawn to compare with."""
NOWHERE = np.zeros(0, int)
"""No breaks."""


class Style(NamedTuple):
    """How one result is drawn, wherever it is."""

    color: str
    fill: str
    """colour of its band, fainter the more bands there are"""
    dash: str

    @classmethod
    def of(cls, i: int, total: int) -> "Style":
        """Of result `i` of so many."""
        color, opacity = COLORS[i % len(COLORS)], 0.18 / total**0.5
        parts = ", ".join(str(int(color[j : j + 2], 16)) for j in (1, 3, 5))
        return cls(color, f"rgba({parts}, {opacity:.2f})", DASHES[i // len(COLORS) % len(DASHES)])


def plain(axis: str, title: str) -> go.Figure:
    """A figure of its own."""
    figure = go.Figure(layout={"template": "none"})
    figure.update_layout(meta={"series": False})
    figure.update_xaxes(title_text=axis)
    figure.update_yaxes(title_text=title)
    return figure


def series(x: np.ndarray, axis: str, title: str) -> go.Figure:
    """A figure over the instants of the series, which zooms with the others."""
    figure = plain(axis, title)
    figure.update_layout(hovermode="x unified", meta={"series": True})
    figure.update_xaxes(range=[x.min(), x.max()] if len(x) > 1 else None)
    if x.dtype.kind in "iuf":
        figure.update_xaxes(exponentformat="none", separatethousands=True, hoverformat=",.8~g")
    return figure


def band(
    x: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    *,
    name: str,
    style: Style,
    label: str = "±2σ",
    breaks: np.ndarray = NOWHERE,
) -> go.Scatter:
    """Closed outlines one after the other with NaN between: one, and one more for every break."""
    rows, ends = with_breaks(breaks, low, high)
    known = [part[np.isfinite(low[part]) & np.isfinite(high[part])] for part in np.split(rows, ends)]
    parts = [part for part in known if part.size] or [rows[:0]]
    outline = np.concatenate([side for part in parts for side in (low[part], high[part][::-1])])
    around = np.concatenate([side for part in parts for side in (part, part[::-1])])
    starts = np.cumsum([2 * part.size for part in parts])[:-1]
    at, outline = broken(starts, x[around], compact(outline))
    trace = go.Scatter(x=at, y=outline, fill="toself", mode="lines")
    trace.update(fillcolor=style.fill, line={"width": 0}, hoverinfo="skip")
    return trace.update(name=f"{name} {label}".strip(), legendgroup=name, showlegend=False)


def line(
    x: np.ndarray,
    y: np.ndarray,
    *,
    name: str,
    color: str,
    dash: str = "solid",
    width: float = 1.6,
    breaks: np.ndarray = NOWHERE,
) -> go.Scatter:
    """A curve, with a gap before every break."""
    rows, ends = with_breaks(breaks, y)
    at, curve = broken(ends, x[rows], compact(y[rows]))
    # A line needs two neighbours: what stands alone between gaps, as of a slow sensor, is seen as markers only.
    mode = "lines+markers" if _alone(curve).any() else "lines"
    shown = {"line": {"color": color, "width": width, "dash": dash}, "marker": {"color": color, "size": 4}}
    return go.Scatter(x=at, y=curve, name=name, mode=mode, hovertemplate="%{y:.5g}", **shown)


def dots(x: np.ndarray, y: np.ndarray, *, name: str, color: str, opacity: float = 0.7) -> go.Scatter:
    """What has no line between neighbours."""
    known = np.flatnonzero(np.isfinite(y))
    rows = known[extremes(y[known])] if known.size else known
    marker = {"color": color, "size": 3.5 if rows.size > 500 else 5, "opacity": opacity}
    return go.Scatter(x=x[rows], y=compact(y[rows]), name=name, mode="markers", marker=marker, hovertemplate="%{y:.5g}")


def _alone(curve: np.ndarray) -> np.ndarray:
    known = np.concatenate([[False], np.isfinite(curve), [False]])
    return known[1:-1] & ~known[:-2] & ~known[2:]
