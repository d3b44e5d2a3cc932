"""Figures of the synthetic particle filter experiment: one run, and the errors of all methods."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from sigmapoint.experiments.publishing.results import Mean

COLOURS = ("#009e73", "#d55e00", "#0072b2")


def estimates(x: Float[np.ndarray, " T"], found: Mapping[str, Float[np.ndarray, " T"]]) -> Figure:
    """The state and posterior means above, their errors below."""
    figure = Figure(figsize=(11, 6.5), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    t = np.arange(len(x))
    above.plot(t, x, "o", color="black", ms=4, mfc="none", label="true x")
    for (name, mean), colour in zip(found.items(), COLOURS):
        above.plot(t, mean, color=colour, lw=1.3, label=name)
        below.plot(t[1:], (mean - x)[1:], color=colour, lw=1.3, label=name)
    below.axhline(0, color="black", lw=0.6)
    above.set_ylabel("state x")
    below.set_ylabel("error x̂ − x")
    below.set_xlabel("time")
    above.legend(frameon=False, ncols=1 + len(found), loc="upper right")
    for axis in (above, below):
        axis.margins(x=0.01)
        axis.spines[["top", "right"]].set_visible(False)
    low, high = above.get_ylim()  # room for the legend
    above.set_ylim(low, high + 0.12 * (high - low))
    return figure


def scores(found: Mapping[str, Mapping[str, Mean]], published: Mapping[str, float], least: float) -> Figure:
    """A panel for each case, a line for each method; errors as logarithms."""
    figure = Figure(figsize=(13, 4.2), layout="constrained")
    axes = figure.subplots(1, len(found), sharex=True)
    for axis, (case, by), colour in zip(axes, found.items(), COLOURS):
        rows, values = np.arange(len(by)), np.array([mean.value for mean in by.values()])
        spreads = np.array([mean.spread for mean in by.values()])
        axis.axvline(least, color="0.4", lw=1, ls=":")
        axis.errorbar(values, rows, xerr=2 * spreads, fmt="o", color=colour, ms=5, capsize=3)
        if axis is axes[0]:
            axis.plot([published[name] for name in by], rows, "x", color="black", ms=7, label="published")
            axis.legend(frameon=False, loc="lower left")
        axis.set_xscale("log")
        axis.set_yticks(rows, list(by))
        axis.invert_yaxis()
        axis.set_title(case, fontsize=11)
        axis.set_xlabel("RMSE")
        axis.grid(axis="x", color="0.92")
        axis.spines[["top", "right"]].set_visible(False)
    return figure
