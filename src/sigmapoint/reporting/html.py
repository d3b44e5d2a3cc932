"""Pieces of HTML: everything that comes from the user is escaped here."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

import plotly.graph_objects as go

from sigmapoint.diagnosis.verdict import RANK, Verdict, gravest_first

WORDS = {"good": "✓ Good", "warning": "! Look at this", "bad": "✕ Problem"}


def number(value: Any) -> str:
    """A value as people read it: five digits, thousands apart, – for nothing."""
    if value is None:
        return "–"
    if isinstance(value, bool) or not hasattr(value, "__float__"):
        return str(value)
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\u202f") if abs(value) >= 10_000 else str(value)
    value = float(value)
    if not math.isfinite(value):
        return "–" if math.isnan(value) else ("∞" if value > 0 else "−∞")
    if 10_000 <= abs(value) < 1e9:
        return f"{value:,.0f}".replace(",", "\u202f").replace("-", "−")
    return f"{value:.5g}".replace("-", "−")


def card(label: str, value: Any, hint: str = "") -> str:
    """One number of the summary."""
    return (
        f'<div class="card"><div class="label">{escape(label)}</div><div class="value">{escape(number(value))}</div>'
        f'<div class="hint">{escape(hint)}</div></div>'
    )


def verdict_list(verdicts: Iterable[Verdict]) -> str:
    """Verdicts, the gravest first, each with its severity as a word, a mark and a colour."""
    items = "".join(
        f'<li class="{v.severity}"><b>{WORDS[v.severity]}</b><span>{escape(v.text)}</span></li>'
        for v in gravest_first(verdicts)
    )
    return f'<ul class="verdicts">{items}</ul>'


def badge(verdicts: Sequence[Verdict]) -> str:
    """The gravest severity among verdicts."""
    worst = min((v.severity for v in verdicts), key=RANK.__getitem__, default="warning")
    return f'<span class="badge {worst}">{WORDS[worst]}</span>'


def table(caption: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """A table with the columns of all rows, in order of appearance; numbers to the right."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    numeric = {c for c in columns if any(_numeric(row.get(c)) for row in rows)}
    head = "".join(f'<th scope="col"{_side(c in numeric)}>{escape(str(c))}</th>' for c in columns)
    body = "".join(
        "<tr>" + "".join(f"<td{_side(c in numeric)}>{escape(number(row.get(c)))}</td>" for c in columns) + "</tr>"
        for row in rows
    )
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    empty = "" if rows else '<tbody><tr><td class="soft">nothing to show</td></tr></tbody>'
    return f'<div class="table"><table>{title}<thead><tr>{head}</tr></thead><tbody>{body}</tbody>{empty}</table></div>'


def section(name: str, title: str, text: str, *parts: str) -> str:
    """A section with an anchor, or nothing where it has no parts."""
    inner = "".join(parts)
    if not inner:
        return ""
    intro = f'<p class="soft">{text}</p>' if text else ""
    return f'<section id="{name}"><h2>{escape(title)}</h2>{intro}{inner}</section>'


class Graphs:
    """Numbers the figures of one page and turns each into a place for it and its data."""

    def __init__(self) -> None:
        self.drawn = 0

    def figure(self, caption: str, figure: go.Figure, hint: str = "") -> str:
        """One figure; its data stay data: `<` is written so that no text in them can end the script."""
        self.drawn += 1
        name = f"graph{self.drawn}"
        data = str(figure.to_json()).replace("<", "\\u003c").replace("\u2028", "\\u2028")
        small = f" <small>{escape(hint)}</small>" if hint else ""
        return (
            f'<figure><figcaption>{escape(caption)}{small}</figcaption><div class="graph" id="{name}"></div>'
            f'<script type="application/json" id="{name}-data">{data}</script></figure>'
        )


def anchor(title: str) -> str:
    """Where a link to a section leads."""
    return re.sub(r"\W+", "-", title.lower())


def grid(columns: str, figures: Sequence[str]) -> str:
    """Figures side by side where there is room."""
    return f'<div class="grid {columns}">{"".join(figures)}</div>' if figures else ""


def grid_of(figures: Sequence[str]) -> str:
    """In two columns where there are more than two."""
    return grid("two" if len(figures) > 2 else "", figures)


def few(drawn: int, total: int, what: str) -> str:
    """That not all are drawn, where that is so."""
    return f'<p class="soft">The first {drawn} of {total} {what} are drawn.</p>' if drawn < total else ""


def _numeric(value: Any) -> bool:
    return hasattr(value, "__float__") and not isinstance(value, bool)


def _side(right: bool) -> str:
    return ' class="number"' if right else ""
