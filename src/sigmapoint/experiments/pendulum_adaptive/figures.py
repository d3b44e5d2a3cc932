"""Figures of adaptive control of the pendulum: one trial, its parameters, and how many succeed."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sigmapoint.experiments.publishing.results import Mean
from sigmapoint.problems.pendulum import STEP

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#555555")


def tracks(trial: Any) -> Figure:
    """Angles, cart, force."""
    figure = Figure(figsize=(11, 7), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True, height_ratios=(2, 1, 1))
    time = STEP * np.arange(len(trial.force))
    for i, (name, colour) in enumerate(zip(("angle 1", "angle 2"), COLOURS)):
        axes[0].plot(time, trial.state[:, 2 + 2 * i], color=colour, lw=1.3, label=f"{name}, true")
        axes[0].plot(time, trial.mean[:, 2 + 2 * i], ".", color=colour, ms=2.5, alpha=0.6, label=f"{name}, estimated")
    axes[1].plot(time, trial.state[:, 0], color="black", lw=1.2)
    axes[2].step(time, trial.force, color="black", lw=0.8, where="post")
    axes[2].set_yscale("symlog", linthresh=10)
    axes[0].axhline(0, color="0.7", lw=0.7)
    axes[0].legend(frameon=False, ncols=2, loc="upper right")
    for axis, label in zip(axes, ("angles [rad]", "cart [m]", "force [N]")):
        axis.set_ylabel(label)
        axis.margins(x=0.01)
        axis.spines[["top", "right"]].set_visible(False)
    axes[2].set_xlabel("time [s]")
    return figure


def converging(trial: Any, truth: Mapping[str, float]) -> Figure:
    """A panel for each parameter; time as logarithm, since it is learned in the first steps."""
    figure = Figure(figsize=(13, 3.4), layout="constrained")
    axes = figure.subplots(1, len(truth))
    time = STEP * np.arange(1, len(trial.force) + 1)
    known = trial.parameters
    for axis, colour, (name, true), value, low, high in zip(
        axes, COLOURS, truth.items(), known.value, known.low, known.high
    ):
        axis.fill_between(time, low, high, color=colour, alpha=0.2, lw=0)
        axis.plot(time, value, color=colour, lw=1.3)
        axis.axhline(true, color="black", lw=0.9, ls="--")
        axis.set_xscale("log")
        axis.set_ylim(0, 2.5 * true)
        axis.set_title(name)
        axis.set_xlabel("time [s]")
        axis.spines[["top", "right"]].set_visible(False)
    return figure


def successes(found: Mapping[str, Mapping[str, Mean]]) -> Figure:
    """A group for each level of noise, a point for each way."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    axis = figure.subplots()
    names = list(next(iter(found.values())))
    for j, name in enumerate(names):
        means = [by[name] for by in found.values()]
        where = np.arange(len(found)) + 0.5 * (j / max(1, len(names) - 1) - 0.5)
        values, spreads = [m.value for m in means], [m.spread for m in means]
        axis.errorbar(where, values, yerr=spreads, fmt="o", ms=5, color=COLOURS[j], label=name, capsize=2)
    axis.set_xticks(np.arange(len(found)), list(found))
    axis.set_ylim(0, 1.03)
    axis.set_ylabel("share of trials")
    axis.grid(axis="y", color="0.9")
    axis.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside right center", frameon=False)
    return figure
