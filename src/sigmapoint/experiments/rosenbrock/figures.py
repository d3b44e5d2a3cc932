"""Figure of the Rosenbrock experiment: paths over contours, f by iteration, and what each method cost."""

from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sigmapoint.experiments.rosenbrock.searches import TARGET, Search
from sigmapoint.problems import rosenbrock

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#8c6d00")
STYLES = ("-", "--", ":", "-.", (0, (4, 1, 1, 1, 1, 1)))
TICKS = (2, 5, 10, 20, 50)
LEAST = 1e-26
"""What is drawn of f below it."""


def valley(shown: Mapping[str, Sequence[Search]], found: Mapping[str, Sequence[Search]]) -> Figure:
    """Paths and f of the methods `shown` from the first start; values and derivatives of all that was found."""
    figure = Figure(figsize=(16, 5), layout="constrained")
    contours, costs, effort = figure.subplots(1, 3, width_ratios=(1.1, 1, 1.1))
    _contours(contours)
    for i, (name, searches) in enumerate(shown.items()):
        first, style = searches[0], {"color": COLOURS[i], "ls": STYLES[i], "marker": "o", "ms": 3, "label": name}
        end = 1 + (int(np.argmax(first.costs <= LEAST)) or len(first.costs))
        contours.plot(*first.path.T, **style)
        costs.semilogy(np.maximum(first.costs, LEAST)[:end], **style)
    contours.legend(frameon=False, fontsize=9, loc="lower left")
    costs.axhline(TARGET, color="black", lw=0.8, ls=":")
    costs.set_xlim(0, 40)
    costs.set_xlabel("iteration")
    costs.set_ylabel("f")
    costs.spines[["top", "right"]].set_visible(False)
    _effort(effort, found)
    return figure


def _contours(axis: Axes) -> None:
    x, y = np.meshgrid(np.linspace(-2, 2, 200), np.linspace(-4.5, 3.5, 200))
    f = np.asarray(rosenbrock.cost(jnp.stack([x, y], axis=-1)))
    axis.contour(x, y, f, levels=np.logspace(-1, 3.5, 10), colors="0.8", linewidths=0.7)
    axis.plot(1, 1, "*", color="black", ms=12)
    axis.set_xlim(-2, 2)
    axis.set_ylim(-4.5, 3.5)
    axis.set_xlabel("x₁")
    axis.set_ylabel("x₂")


def _effort(axis: Axes, found: Mapping[str, Sequence[Search]]) -> None:
    rng = np.random.default_rng(0)
    kinds = {"values": (lambda s: s.values, -0.18), "derivatives": (lambda s: s.derivatives, 0.18)}
    for colour, (kind, (of, shift)) in zip(COLOURS, kinds.items()):
        axis.plot([], [], ".", color=colour, label=kind)
        for row, searches in enumerate(found.values()):
            counts = np.array([of(s) or np.nan for s in searches])
            height = row + shift + rng.uniform(-0.12, 0.12, len(counts))
            axis.plot(counts[1:], height[1:], ".", color=colour, ms=4, alpha=0.4)
            axis.plot(counts[:1], [row + shift], "x", color="black", ms=7, mew=2)
    axis.set_yticks(range(len(found)), list(found))
    axis.invert_yaxis()
    axis.set_xscale("log")
    axis.set_xticks(TICKS, [str(tick) for tick in TICKS])
    axis.minorticks_off()
    axis.set_xlabel("until f ≤ 1e-12")
    axis.spines[["top", "right"]].set_visible(False)
    axis.legend(frameon=False, fontsize=9, loc="upper right", bbox_to_anchor=(1, 0.8))
