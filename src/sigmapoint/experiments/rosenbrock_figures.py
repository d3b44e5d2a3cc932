"""Figure of the Rosenbrock experiment: paths over contours, f by iteration, and what each method cost."""

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#8c6d00")
STYLES = ("-", "--", ":", "-.", (0, (4, 1, 1, 1, 1, 1)))
LEAST = 1e-34
"""What is drawn of f = 0."""


class Search(Protocol):
    """What is drawn of a search."""

    @property
    def path(self) -> Float[np.ndarray, "K 2"]: ...

    @property
    def costs(self) -> Float[np.ndarray, " K"]: ...

    @property
    def values(self) -> float: ...

    @property
    def derivatives(self) -> float: ...


def valley(shown: Mapping[str, Sequence[Search]], found: Mapping[str, Sequence[Search]]) -> Figure:
    """Paths and costs of the methods `shown` from the first start; values and derivatives of all that was found."""
    figure = Figure(figsize=(15, 5), layout="constrained")
    contours, costs, effort = figure.subplots(1, 3, width_ratios=(1.1, 1, 1))
    _contours(contours)
    for i, (name, searches) in enumerate(shown.items()):
        first, style = searches[0], {"color": COLOURS[i], "ls": STYLES[i], "marker": "o", "ms": 3, "label": name}
        contours.plot(*first.path.T, **style)
        costs.semilogy(np.maximum(first.costs, LEAST)[: 1 + _last(first.costs)], **style)
    contours.legend(frameon=True, fontsize=9, loc="upper center")
    costs.axhline(1e-12, color="black", lw=0.8, ls=":")
    costs.set_xlabel("iteration")
    costs.set_ylabel("f")
    _effort(effort, found)
    return figure


def _last(costs: np.ndarray) -> int:
    """Where there is nothing more to gain."""
    return int(np.argmax(costs <= 1e-24)) or len(costs) - 1


def _contours(axis: Axes) -> None:
    x, y = np.meshgrid(np.linspace(-2, 2, 200), np.linspace(-1.5, 3.5, 200))
    f = 100 * (y - x**2) ** 2 + (1 - x) ** 2
    axis.contour(x, y, f, levels=np.logspace(-1, 3.5, 10), colors="0.8", linewidths=0.7)
    axis.plot(1, 1, "*", color="black", ms=12)
    axis.set_xlim(-2, 2)
    axis.set_ylim(-1.5, 3.5)
    axis.set_xlabel("x₁")
    axis.set_ylabel("x₂")


def _effort(axis: Axes, found: Mapping[str, Sequence[Search]]) -> None:
    rng = np.random.default_rng(0)
    for row, searches in enumerate(found.values()):
        for of, colour, shift in ((lambda s: s.values, COLOURS[0], -0.15), (lambda s: s.derivatives, COLOURS[1], 0.15)):
            counts = np.array([of(s) for s in searches])
            counts[counts == 0] = np.nan
            height = row + shift + rng.uniform(-0.08, 0.08, len(counts))
            axis.plot(counts[1:], height[1:], ".", color=colour, ms=4, alpha=0.4)
            axis.plot(counts[:1], [row + shift], "x", color="black", ms=7)
    axis.plot([], [], ".", color=COLOURS[0], label="values")
    axis.plot([], [], ".", color=COLOURS[1], label="derivatives")
    axis.set_yticks(range(len(found)), list(found))
    axis.invert_yaxis()
    axis.set_xscale("log")
    axis.set_xlabel("until f ≤ 1e-12")
    axis.legend(frameon=False, fontsize=9)
