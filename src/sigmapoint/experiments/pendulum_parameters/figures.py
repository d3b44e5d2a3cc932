"""Figures of learning the pendulum's parameters: estimates fall by fall, and the masses' common factor by prior."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

COLOURS = ("#0072b2", "#56b4e9", "#d55e00", "#e69f00", "#009e73")
STYLES = (":", "-")


def estimates(cases: Mapping[str, Mapping[str, Float[np.ndarray, "R E P"]]], truth: Mapping[str, float]) -> Figure:
    """Mean over runs of every parameter, fall by fall from one, with a band of one standard deviation."""
    figure = Figure(figsize=(13, 5), layout="constrained")
    axes = figure.subplots(1, len(cases), sharey=True, squeeze=False)[0]
    for axis, (case, found) in zip(axes, cases.items()):
        for style, (name, runs) in zip(STYLES, found.items()):
            whole = np.concatenate([np.ones_like(runs[:, :1]), runs], axis=1)
            falls, mean, deviation = np.arange(whole.shape[1]), whole.mean(0), whole.std(0, ddof=1)
            for i, (parameter, colour) in enumerate(zip(truth, COLOURS)):
                label = f"{parameter}, {name}" if axis is axes[0] else None
                axis.plot(falls, mean[:, i], ls=style, color=colour, label=label)
                low, high = mean[:, i] - deviation[:, i], mean[:, i] + deviation[:, i]
                axis.fill_between(falls, low, high, color=colour, alpha=0.12, lw=0)
        for colour, value in zip(COLOURS, truth.values()):
            axis.axhline(value, color=colour, lw=0.7, alpha=0.7)
        axis.set_title(case)
        axis.set_xlabel("fall")
        axis.set_ylim(0.75 * min(truth.values()), 1.15 * max(truth.values()))
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("half lengths [m], masses [kg]")
    figure.legend(loc="outside right center", frameon=False)
    return figure


def factors(found: Mapping[str, Mapping[float, Float[np.ndarray, " R"]]], nearest: float) -> Figure:
    """The common factor of the masses that a method ends at, by the prior standard deviation."""
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axis = figure.subplots()
    for i, (name, samples) in enumerate(found.items()):
        shift = 1 + 0.02 * (i - 1.5)
        values, spreads = zip(*((np.nanmean(s), np.nanstd(s, ddof=1)) for s in samples.values()))
        where = shift * np.array(list(samples))
        axis.errorbar(where, values, yerr=spreads, fmt="o-", ms=4, color=COLOURS[i], label=name, capsize=3)
    axis.axhline(1.0, color="black", lw=0.8, label="truth")
    axis.axhline(nearest, color="black", lw=0.8, ls=":", label="nearest to the start")
    axis.set_xlabel("prior standard deviation of each parameter [m, kg]")
    axis.set_ylabel("learned masses / true masses")
    axis.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside right center", frameon=False)
    return figure
