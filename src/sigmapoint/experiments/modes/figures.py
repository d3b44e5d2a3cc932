"""Figures of estimated frequencies: all runs over steps, and how many arrive."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from sigmapoint.experiments.publishing.results import Mean

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#555555", "#882255", "#117733")


def tracks(found: Mapping[str, Float[np.ndarray, "R T 2"]], truth: Float[np.ndarray, "2"]) -> Figure:
    """A column for each method, both frequencies in it."""
    figure = Figure(figsize=(11, 4.5), layout="constrained")
    axes = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
    for axis, (name, value) in zip(axes, found.items()):
        for i in range(2):
            axis.plot(value[:, :, i].T, color=COLOURS[i], lw=0.6, alpha=0.35)
            axis.axhline(truth[i], color="black", lw=1, ls="--")
            axis.annotate(f"ω{i + 1}", (1.0, truth[i]), xycoords=("axes fraction", "data"), va="center")
        close = np.abs(value[:, -1] / truth - 1) < 0.01
        first, second = close.mean(0)
        axis.set_title(f"{name}\nwithin 1 %: ω1 {first:.0%}, ω2 {second:.0%}", fontsize=10)
        axis.set_xlabel("step")
        axis.set_ylim(0, 2 * truth[1])
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("frequency [rad/s]")
    return figure


def shares(found: Mapping[str, Mapping[str, Mean]]) -> Figure:
    """A line of points for each case, a point for each method."""
    figure = Figure(figsize=(10, 1.2 + 0.4 * len(found)), layout="constrained")
    axis = figure.subplots()
    names = list(next(iter(found.values())))
    for j, name in enumerate(names):
        means = [by[name] for by in found.values()]
        where = np.arange(len(found)) + 0.6 * (j / max(1, len(names) - 1) - 0.5)
        values, spreads = [m.value for m in means], [m.spread for m in means]
        axis.errorbar(values, where, xerr=spreads, fmt="o", ms=4, color=COLOURS[j], label=name)
    axis.set_yticks(np.arange(len(found)), list(found))
    axis.invert_yaxis()
    axis.set_xlim(0, 1.03)
    axis.set_xlabel("share of runs")
    axis.grid(axis="x", color="0.9")
    axis.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside right upper", frameon=False)
    return figure
