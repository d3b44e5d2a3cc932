"""Figures of joint estimation on a cell: capacity and series resistance over time with their intervals."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sigmapoint.problems.battery_joint import Held, jumps

COLOUR = "#0072b2"


def tracks(cells: Mapping[int, Held], found: Mapping[int, Any]) -> Figure:
    """A column for each temperature."""
    figure = Figure(figsize=(13, 6.5), layout="constrained")
    axes = figure.subplots(2, len(cells), sharex="col", squeeze=False)
    for column, (temperature, held) in zip(axes.T, cells.items()):
        one, hours = found[temperature], (held.log.time - held.log.time[0]) / 3600
        start = int(np.argmax(np.abs(one.capacity[:, 0] / held.counted - 1)))
        other = int(np.argmin(np.abs(one.capacity[:, 0] / held.counted - 1)))
        at, seen = jumps(held.log)
        _interval(column[0], hours, one.capacity, one.capacity_low, one.capacity_high, start, other)
        _interval(column[1], hours, 1e3 * one.r0, 1e3 * one.r0_low, 1e3 * one.r0_high, start, other)
        column[0].axhline(held.counted, color="black", lw=1, label="counted")
        column[1].plot(hours[at], 1e3 * seen, "k.", ms=4, label="jumps")
        column[0].set_ylim(0.75 * held.counted, 1.25 * held.counted)
        middle = 1e3 * np.median(seen)
        column[1].set_ylim(0.75 * middle, 1.25 * middle)
        column[0].set_title(f"{temperature} °C")
        column[1].set_xlabel("time [h]")
        for axis in column:
            axis.legend(frameon=False, loc="upper right", ncols=2)
            axis.spines[["top", "right"]].set_visible(False)
            axis.margins(x=0.01)
    axes[0, 0].set_ylabel("capacity [Ah]")
    axes[1, 0].set_ylabel("series resistance [mΩ]")
    return figure


def _interval(
    axis: Any, hours: np.ndarray, value: np.ndarray, low: np.ndarray, high: np.ndarray, start: int, other: int
) -> None:
    axis.fill_between(hours, low[start], high[start], color=COLOUR, alpha=0.2, lw=0, label="95 %")
    axis.plot(hours, value[start], color=COLOUR, lw=1.3, label="estimate")
    axis.plot(hours, value[other], color=COLOUR, lw=1, ls=":", label="another start")


def errors(cells: Mapping[int, Held], found: Mapping[int, Any], close: float) -> Figure:
    """Of the capacity in percent, all starts."""
    figure = Figure(figsize=(13, 3.6), layout="constrained")
    axes = figure.subplots(1, len(cells), sharey=True, squeeze=False)[0]
    for axis, (temperature, held) in zip(axes, cells.items()):
        one, hours = found[temperature], (held.log.time - held.log.time[0]) / 3600
        for row in one.capacity:
            axis.plot(hours, 100 * (row / held.counted - 1), color=COLOUR, lw=0.7, alpha=0.6)
        low, high = (100 * (bound[0] / held.counted - 1) for bound in (one.capacity_low, one.capacity_high))
        axis.fill_between(hours, low, high, color=COLOUR, alpha=0.15, lw=0)
        axis.axhline(0, color="black", lw=0.8)
        for side in (-close, close):
            axis.axhline(side, color="black", lw=0.8, ls="--")
        axis.set_ylim(-25, 25)
        axis.set_title(f"{temperature} °C")
        axis.set_xlabel("time [h]")
        axis.margins(x=0.01)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("error of the capacity [%]")
    return figure
