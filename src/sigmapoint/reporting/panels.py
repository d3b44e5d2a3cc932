"""Sections that a result names itself (`contents`), as HTML: cards, verdicts, tables and panels of curves."""

from collections.abc import Iterable

import numpy as np
import plotly.graph_objects as go

from sigmapoint.contents import Curve, Panel, Section
from sigmapoint.plotting import BAND, SHOWN
from sigmapoint.reporting import traces
from sigmapoint.reporting.decimate import compact, with_breaks
from sigmapoint.reporting.html import Graphs, anchor, card, few, grid_of, section, table, verdict_list
from sigmapoint.reporting.traces import NOWHERE, REFERENCE, Style

MARKED = 50
"""Points up to which each is marked, of curves over steps."""
FEW = 12
"""Steps up to which each has a tick."""


def named(sections: Iterable[Section], x: np.ndarray, axis: str, graphs: Graphs) -> dict[str, str]:
    """By title; `x` are the instants of the series, and `axis` says what those are."""
    return {part.title: _section(part, x, axis, graphs) for part in sections}


def _section(part: Section, x: np.ndarray, axis: str, graphs: Graphs) -> str:
    shown = list(part.panels.items())[:SHOWN]
    cards = "".join(card(*each) for each in part.cards)
    return section(
        anchor(part.title),
        part.title,
        part.text,
        f'<div class="cards">{cards}</div>' if cards else "",
        verdict_list(part.verdicts) if part.verdicts else "",
        *(table(caption, rows) for caption, rows in part.tables.items()),
        few(len(shown), len(part.panels), "figures"),
        grid_of([graphs.figure(what, panel_figure(what, panel, x, axis)) for what, panel in shown]),
    )


def panel_figure(what: str, panel: Panel, x: np.ndarray, axis: str) -> go.Figure:
    """All curves of a panel, each with its band."""
    height = panel.height or what
    figure = traces.plain(panel.axis, height) if panel.axis else traces.series(x, axis, height)
    for i, curve in enumerate(panel.curves):
        _add(figure, curve, x if curve.x is None else curve.x, Style.of(i, len(panel.curves)))
    if panel.level is not None:
        figure.add_hline(panel.level, line={"color": REFERENCE, "width": 1.4, "dash": "dot"})
    return figure.update_layout(showlegend=len(panel.curves) > 1)


def _add(figure: go.Figure, curve: Curve, x: np.ndarray, style: Style) -> None:
    y, name = np.where(np.isfinite(curve.y), curve.y, np.nan), curve.name or "estimate"
    line = traces.line(x, y, name=name, color=style.color, dash=style.dash).update(legendgroup=curve.name)
    if curve.x is not None and len(x) <= MARKED:
        line.update(mode="lines+markers")
    if x.dtype.kind == "i" and len(x) <= FEW:
        figure.update_xaxes(dtick=1)
    if curve.low is not None and curve.high is not None:
        figure.add_trace(traces.band(x, curve.low, curve.high, name=curve.name, style=style, label=BAND))
        rows = with_breaks(NOWHERE, y)[0]
        ends = np.stack([compact(end[rows]) for end in (curve.low, curve.high)], axis=-1)
        line.update(customdata=ends, hovertemplate="%{y:.5g} (%{customdata[0]:.4g} … %{customdata[1]:.4g})")
    figure.add_trace(line)
