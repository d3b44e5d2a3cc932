"""What a page or a drawing about a result holds, as plain data: each result names it, and who draws asks for no more.

There are posteriors over one series, which have sections of their own, and further sections: cards, verdicts, tables
and panels of curves. Results that are shown together are joined: sections, tables and panels of the same name become
one, with the curves of all.
"""

from collections.abc import Mapping
from functools import reduce
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from sigmapoint.diagnosis.verdict import Verdict
from sigmapoint.results import Posterior

Row = Mapping[str, Any]


class Card(NamedTuple):
    """One number."""

    label: str
    value: Any
    hint: str = ""


class Curve(NamedTuple):
    """One line of a panel."""

    y: Float[np.ndarray, "T"]
    low: Float[np.ndarray, "T"] | None = None
    """where its 95 % band begins, if it has one"""
    high: Float[np.ndarray, "T"] | None = None
    """where that ends"""
    x: np.ndarray | None = None
    """where (T,); at the instants of the series where not given"""
    name: str = ""
    """of the result that it is of, among several"""


class Panel(NamedTuple):
    """Curves over the same axis."""

    curves: tuple[Curve, ...]
    axis: str = ""
    """what that is; the instants of the series where not given"""
    height: str = ""
    """what the vertical axis says; the name of the panel where not given"""
    level: float | None = None
    """a height to compare with"""


class Section(NamedTuple):
    """One part of a page."""

    title: str
    text: str = ""
    cards: tuple[Card, ...] = ()
    verdicts: tuple[Verdict, ...] = ()
    tables: Mapping[str, tuple[Row, ...]] = {}
    """by caption"""
    panels: Mapping[str, Panel] = {}
    """by what is drawn"""

    def named(self, name: str) -> "Section":
        """The same as that of one result among several."""
        return self._replace(
            cards=tuple(card._replace(label=f"{name}: {card.label}") for card in self.cards),
            verdicts=tuple(said._replace(text=f"{name}: {said.text}") for said in self.verdicts),
            tables={caption: tuple({"of": name, **row} for row in rows) for caption, rows in self.tables.items()},
            panels={what: panel._replace(curves=_named(panel.curves, name)) for what, panel in self.panels.items()},
        )

    def with_those_of(self, other: "Section") -> "Section":
        """Both in one."""
        tables, panels = dict(self.tables), dict(self.panels)
        for caption, rows in other.tables.items():
            tables[caption] = (*tables.get(caption, ()), *rows)
        for what, panel in other.panels.items():
            before = panels[what].curves if what in panels else ()
            panels[what] = panel._replace(curves=(*before, *panel.curves))
        cards, verdicts = (*self.cards, *other.cards), (*self.verdicts, *other.verdicts)
        return self._replace(cards=cards, verdicts=verdicts, tables=tables, panels=panels)


class Contents(NamedTuple):
    """All that there is to show of a result."""

    posteriors: Mapping[str, Posterior] = {}
    """by name; that of the only one is empty"""
    sections: tuple[Section, ...] = ()


@runtime_checkable
class Shown(Protocol):
    """A result of which there can be a page."""

    def contents(self) -> Contents:
        """What there is to show of it."""
        ...


def joined(parts: Mapping[str, Contents]) -> Contents:
    """Several by name in one."""
    posteriors: dict[str, Posterior] = {}
    found: dict[str, dict[str, Section]] = {}
    for name, part in parts.items():
        posteriors |= {f"{name} {own}".strip(): post for own, post in part.posteriors.items()}
        for section in part.sections:
            found.setdefault(section.title, {})[name] = section
    return Contents(posteriors, tuple(_together(sections) for sections in found.values()))


def _together(sections: Mapping[str, Section]) -> Section:
    """Those of the same title; where there is one, it needs no name."""
    if len(sections) == 1:
        return next(iter(sections.values()))
    return reduce(Section.with_those_of, (section.named(name) for name, section in sections.items()))


def _named(curves: tuple[Curve, ...], name: str) -> tuple[Curve, ...]:
    return tuple(curve._replace(name=f"{name} {curve.name}".strip()) for curve in curves)
