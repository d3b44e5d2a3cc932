"""Figures of the scalar experiment: one series as in the notes' sections 6.2 and 6.6, and all methods side by side."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sigmapoint.experiments.publishing.results import Mean

COLOURS = ("#c44e00", "#0072b2")


def single_run(x: np.ndarray, beliefs: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Figure:
    """Truth, estimate and ±3σ above, error and ±3σ below; a column for each method."""
    figure = Figure(figsize=(11, 6.5), layout="constrained")
    axes = figure.subplots(2, len(beliefs), sharex=True, sharey="row", squeeze=False)
    for column, (name, (mean, std)), colour in zip(axes.T, beliefs.items(), COLOURS):
        _bounded(column[0], mean, 3 * std, colour)
        column[0].plot(x, color="black", lw=1.2, label="truth")
        column[0].plot(mean, ".--", color=colour, lw=1, ms=5, label="estimate")
        outside = np.abs(mean - x) > 3 * std
        column[0].set_title(f"{name}: {outside.sum()} of {len(x)} errors outside ±3σ")
        _bounded(column[1], np.zeros_like(mean), 3 * std, colour)
        column[1].axhline(0, color="black", lw=0.6)
        column[1].plot(mean - x, "-", color="0.35", lw=1, label="error")
        column[1].plot(np.flatnonzero(outside), (mean - x)[outside], "x", color="black", ms=6, label="outside")
        column[1].set_xlabel("step")
        for axis in column:
            axis.legend(frameon=False, ncols=3, loc="upper left")
            axis.margins(x=0.01)
    axes[0, 0].set_ylabel("state x")
    axes[1, 0].set_ylabel("error x̂ − x")
    for row in axes:  # room for the legend
        low, high = row[0].get_ylim()
        row[0].set_ylim(low, high + 0.15 * (high - low))
    return figure


def _bounded(axis: Axes, centre: np.ndarray, half: np.ndarray, colour: str) -> None:
    steps = np.arange(len(centre))
    axis.fill_between(steps, centre - half, centre + half, color=colour, alpha=0.25, lw=0, label="±3σ")


def all_methods(scores: Mapping[str, tuple[Mean, Mean]], nominal: float) -> Figure:
    """RMSE, and share of errors within ±3σ, of every method."""
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    rows = np.arange(len(scores))
    titles = ("RMSE (less is better)", f"share of errors within ±3σ (dashed: {nominal}, Gaussian)")
    for axis, title, means in zip(axes, titles, zip(*scores.values())):
        values, spreads = np.array([m.value for m in means]), np.array([m.spread for m in means])
        axis.hlines(rows, 0, values, color="0.85", lw=6)
        axis.errorbar(values, rows, xerr=2 * spreads, fmt="o", color=COLOURS[1], ms=5, capsize=3)
        for row, value, spread in zip(rows, values, spreads):
            axis.annotate(
                f"{value:.3f}", (value + 2 * spread, row), xytext=(8, 0), textcoords="offset points", va="center"
            )
        axis.set_title(title, fontsize=11)
        axis.set_xlim(0, 1.18 * np.nanmax(values))
        axis.spines[["top", "right"]].set_visible(False)
    axes[1].axvline(nominal, color="black", ls="--", lw=0.8, zorder=0)
    axes[0].set_yticks(rows, list(scores))
    axes[0].invert_yaxis()
    return figure
