"""Figures of the noisy Mackey-Glass series."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from sigmapoint.experiments.learning.figures import COLOURS
from sigmapoint.experiments.publishing.results import Mean

SHOWN = slice(100, 200)
"""samples of a stretch"""
COMPARED = ("EKF", "SR-UKF")


def stretch(
    clean: Float[np.ndarray, " T"], noisy: Float[np.ndarray, " T"], means: Mapping[str, Float[np.ndarray, "R T"]]
) -> Figure:
    """The series with its estimates, and what they are off by."""
    figure = Figure(figsize=(11, 6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    k = np.arange(len(clean))[SHOWN]
    above.plot(k, noisy[SHOWN], "+", color="0.6", ms=6, label="measured")
    above.plot(k, clean[SHOWN], color="black", lw=1.5, label="clean")
    for name, colour, style in zip(COMPARED, COLOURS[1::-1], ("--", "-")):
        above.plot(k, means[name][0, SHOWN], color=colour, ls=style, lw=1.3, label=name)
        below.plot(k, means[name][0, SHOWN] - clean[SHOWN], color=colour, ls=style, lw=1.2)
    below.axhline(0, color="0.7", lw=0.7)
    above.set_ylabel("x, normalised")
    below.set_ylabel("error")
    below.set_xlabel("sample, 6 s each")
    for axis in (above, below):
        axis.margins(x=0.01)
        axis.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper center", ncols=4, frameon=False)
    return figure


def scores(errors: Mapping[str, Mean], seconds: Mapping[str, Float[np.ndarray, " K"]]) -> Figure:
    """Errors, and times."""
    figure = Figure(figsize=(10, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.bar(
        range(len(errors)),
        [m.value for m in errors.values()],
        0.6,
        yerr=[m.spread for m in errors.values()],
        color=COLOURS[0],
    )
    left.set_ylabel("normalised mean squared error")
    quartiles = np.array([1e6 * np.quantile(one, [0.25, 0.5, 0.75]) for one in seconds.values()]).T
    spread = np.abs(quartiles[[0, 2]] - quartiles[1])
    right.errorbar(range(len(seconds)), quartiles[1], yerr=spread, fmt="o", ms=5, capsize=3, color=COLOURS[1])
    right.set_ylabel("time of a step [µs]")
    right.set_ylim(bottom=0)
    for axis, names in ((left, list(errors)), (right, list(seconds))):
        axis.set_xticks(range(len(names)), names, rotation=25, ha="right")
        axis.set_xlim(-0.6, len(names) - 0.4)
        axis.spines[["top", "right"]].set_visible(False)
        axis.grid(axis="y", color="0.92")
        axis.set_axisbelow(True)
    return figure
