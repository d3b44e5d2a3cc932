"""Figures of the F-15: a flight with what a filter makes of it, and the factors by which a failure shows."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from sigmapoint.problems.f15_mission import Flight
from sigmapoint.problems.f15_simulator import NAMES, STEP

TRUE, ESTIMATE, SEEN = "black", "#0072b2", "0.75"
COLOURS = {"stabilator": "#d55e00", "lift": "#009e73"}
QUANTITIES = ("altitude [m]", "speed [m/s]", "roll [°]", "pitch [°]", "heading [°]")


def path(flight: Flight, y: Float[np.ndarray, "T 12"], belief: Any, failure: int) -> Figure:
    """From above, and altitude over the distance flown."""
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    above, beside = figure.subplots(1, 2)
    true, mean = flight.state[:, :3] / 1000, belief.mean[:, :3] / 1000
    flown = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(true[:, :2], axis=0), axis=1)))
    for axis, x, i in ((above, [part[:, 1] for part in (true, mean, y / 1000)], 0), (beside, [flown] * 3, 2)):
        axis.plot(x[2], y[:, i] / 1000, ".", color=SEEN, ms=2, label="measured")
        axis.plot(x[1], mean[:, i], color=ESTIMATE, lw=2.5, alpha=0.7, label="estimated")
        axis.plot(x[0], true[:, i], color=TRUE, lw=1, label="true")
        axis.plot(x[0][failure], true[failure, i], "o", color=COLOURS["stabilator"], ms=8, mfc="none", mew=2)
    above.set_aspect("equal", adjustable="datalim")
    above.set_xlabel("east [km]")
    above.set_ylabel("north [km]")
    beside.set_xlabel("distance flown [km]")
    beside.set_ylabel("altitude [km]")
    above.legend(frameon=False, markerscale=4)
    _plain(above, beside)
    return figure


def mission(flight: Flight, y: Float[np.ndarray, "T 12"], belief: Any, failure: int) -> Figure:
    """A column for each quantity: its course above, the error of the estimate below."""
    figure = Figure(figsize=(17, 6), layout="constrained")
    axes = figure.subplots(2, 5, sharex=True, height_ratios=(3, 2))
    time = STEP * np.arange(len(y))
    std = np.column_stack([belief.std[:, 2], belief.speed_std, np.rad2deg(belief.std[:, 6:9])])
    parts = zip(QUANTITIES, *(_shown(part).T for part in (flight.state, y, belief.mean)), std.T)
    for (course, error), (name, true, seen, mean, sigma) in zip(axes.T, parts):
        course.plot(time, seen, ".", color=SEEN, ms=1.5, label="measured")
        course.plot(time, mean, color=ESTIMATE, lw=2.5, alpha=0.7, label="estimated")
        course.plot(time, true, color=TRUE, lw=0.9, label="true")
        course.set_title(name)
        error.fill_between(time, -2 * sigma, 2 * sigma, color=ESTIMATE, alpha=0.2, lw=0)
        error.plot(time, mean - true, color=ESTIMATE, lw=0.8)
        error.set_ylim(-6 * np.median(sigma), 6 * np.median(sigma))
        error.set_xlabel("time [s]")
        for axis in (course, error):
            axis.axvline(STEP * failure, color="0.3", lw=1, ls=":")
    axes[1, 0].set_ylabel("error, ± 2σ")
    axes[0, 0].legend(frameon=False, markerscale=5)
    _plain(*axes.flat)
    return figure


def _shown(state: Float[np.ndarray, "T n"]) -> Float[np.ndarray, "T 5"]:
    """As `QUANTITIES`."""
    speed = np.linalg.norm(state[:, 3:6], axis=1)
    return np.column_stack([state[:, NAMES.index("altitude")], speed, np.rad2deg(state[:, 6:9])])


def factors(flight: Flight, beliefs: Any, failure: int) -> Figure:
    """A panel for each factor."""
    figure = Figure(figsize=(11, 5.4), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    time = STEP * np.arange(flight.state.shape[1])
    known, truth = beliefs.factors, (flight.stabilator[0], np.ones(len(time)))
    for axis, (name, colour), true in zip(axes, COLOURS.items(), truth):
        value, low, high = (np.asarray(getattr(part, name)) for part in (known.value, known.low, known.high))
        axis.plot(time, value[1:].T, color=colour, lw=0.6, alpha=0.3)
        axis.fill_between(time, low[0], high[0], color=colour, alpha=0.25, lw=0)
        axis.plot(time, value[0], color=colour, lw=1.6)
        axis.step(time, true, color=TRUE, lw=1, ls="--", where="post")
        axis.axvline(STEP * failure, color="0.3", lw=1, ls=":")
        axis.set_ylabel(name)
    axes[0].set_ylim(0.2, 1.4)
    axes[1].set_ylim(0.8, 1.2)
    axes[1].set_xlabel("time [s]")
    _plain(*axes)
    return figure


def _plain(*axes: Any) -> None:
    for axis in axes:
        axis.margins(x=0.01)
        axis.spines[["top", "right"]].set_visible(False)
