"""Figures of the pendulum of which half the states are seen: a film, crashes, errors, and states of one trial."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.animation import FuncAnimation
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from sigmapoint.experiments.publishing.results import mean_of
from sigmapoint.problems.pendulum import STEP, TRUTH, fallen

COLOURS = ("#d55e00", "#0072b2", "#56b4e9", "#009e73")
EVERY = 2
"""steps from one picture of the film to the next"""
RATE = round(1 / (EVERY * STEP))
"""pictures a second"""
STATES = ("cart [m]", "speed [m/s]", "θ1 [rad]", "θ̇1 [rad/s]", "θ2 [rad]", "θ̇2 [rad/s]")
VIEW = 3.0
"""[m] to either side of the cart"""


def joints(state: Float[np.ndarray, " 6"]) -> Float[np.ndarray, "2 3"]:
    """[m] cart, joint and top, across and up."""
    x, _, one, _, two, _ = state
    across = np.cumsum([x, -2 * TRUTH.l1 * np.sin(one), -2 * TRUTH.l2 * np.sin(two)])
    return np.stack([across, np.cumsum([0.0, 2 * TRUTH.l1 * np.cos(one), 2 * TRUTH.l2 * np.cos(two)])])


class _Scene:
    """One pendulum beside its estimate, the cart in the middle; it stands still once a rod is down."""

    def __init__(self, axis: Axes, name: str, colour: str, trial: Any) -> None:
        down = np.asarray(fallen(trial.state)) | ~np.isfinite(trial.state).all(1)
        self.last = int(down.argmax()) if down.any() else len(down) - 1
        self.axis, self.name, self.trial, self.crashes = axis, name, trial, bool(down.any())
        axis.axhline(0, color="0.7", lw=1)
        (self.marks,) = axis.plot([], [], "|", color="0.6", ms=8)
        self.cart = Rectangle((0, -0.12), 0.6, 0.24, color="0.4")
        axis.add_patch(self.cart)
        (self.estimate,) = axis.plot([], [], "o-", color=colour, lw=6, ms=7, solid_capstyle="round", alpha=0.55)
        (self.rods,) = axis.plot([], [], "o-", color="black", lw=2, ms=4)
        axis.set(ylim=(-0.8, 2.7), aspect="equal", yticks=[], xticks=[])
        axis.spines[:].set_visible(False)

    def show(self, k: int) -> None:
        k = min(k, self.last)
        true = joints(self.trial.state[k])
        self.rods.set_data(true)
        self.estimate.set_data(joints(self.trial.mean[k]))
        place = self.trial.state[k, 0]
        metres = np.arange(np.floor(place - VIEW), place + VIEW + 1)
        self.marks.set_data(metres, np.full_like(metres, -0.12))
        self.cart.set_x(place - 0.3)
        self.axis.set_xlim(place - VIEW, place + VIEW)
        said = "crashed" if self.crashes and k == self.last else f"cart at {place:.1f} m".replace("-", "−")
        self.axis.set_title(f"{self.name}, {STEP * k:.2f} s: {said}", fontsize=12)


def film(trials: Mapping[str, Any]) -> FuncAnimation:
    """Pendulums side by side, at the pace they move at, with a moment at the end."""
    figure = Figure(figsize=(9, 3.3))
    axes = figure.subplots(1, len(trials))
    figure.subplots_adjust(left=0.02, right=0.98, top=0.88, bottom=0.02)
    scenes = [_Scene(axis, name, colour, trials[name]) for axis, name, colour in zip(axes, trials, COLOURS)]
    steps = len(next(iter(trials.values())).force)

    def show(k: int) -> list[Any]:
        for scene in scenes:
            scene.show(k)
        return []

    frames = [*range(0, steps, EVERY), *([steps - 1] * 25)]
    return FuncAnimation(figure, show, frames, init_func=list, cache_frame_data=False)


def shares(by: Mapping[float, Mapping[str, Any]], known: float, published: float) -> Figure:
    """Trials that crash by level, and those still up by time at the published and at the middle level."""
    levels = list(by)
    later = levels[len(levels) // 2]
    figure = Figure(figsize=(12, 4), layout="constrained")
    left, *right = figure.subplots(1, 3)
    for (name, colour), shift in zip(zip(by[published], COLOURS), (-0.45, -0.15, 0.15, 0.45)):
        means = [mean_of(1.0 * found[name].fell) for found in by.values()]
        left.errorbar(np.array(levels) + shift, [m.value for m in means], [m.spread for m in means], color=colour,
                      fmt="o-", ms=4, lw=1, capsize=2, label=name)  # fmt: skip
        for axis, level in zip(right, (published, later)):
            up = 1 - by[level][name].down.mean(0)
            axis.plot(STEP * np.arange(len(up)), up, color=colour, lw=1.4)
            axis.set_title(f"{level:g} dB")
    left.axhline(known, color="black", ls="--", lw=0.9)
    left.set_title("control by the estimate")
    left.set(xlabel="level of the signal above the noise [dB]", ylabel="share of trials that crash", ylim=(-0.03, 1.03))
    for axis in right:
        axis.set(xlabel="time [s]", ylabel="share of trials still up", ylim=(-0.03, 1.03))
    for axis in (left, *right):
        axis.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside right center", frameon=False)
    return figure


def errors(by: Mapping[float, Mapping[str, Any]], names: Sequence[str]) -> Figure:
    """A panel for each unseen state."""
    figure = Figure(figsize=(12, 4), layout="constrained")
    axes = figure.subplots(1, len(names))
    levels = np.array(list(by))
    for i, (axis, state) in enumerate(zip(axes, names)):
        for (name, colour), shift in zip(zip(next(iter(by.values())), COLOURS), (-0.45, -0.15, 0.15, 0.45)):
            means = [mean_of(found[name].error[:, i]) for found in by.values()]
            axis.errorbar(levels + shift, [m.value for m in means], [m.spread for m in means], color=colour, fmt="o-",
                          ms=4, lw=1, capsize=2, label=name if i == 0 else None)  # fmt: skip
        axis.set_yscale("log")
        axis.set(title=state, xlabel="level of the signal above the noise [dB]")
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("error, only watched")
    figure.legend(loc="outside right center", frameon=False)
    return figure


def states(trials: Mapping[str, Any]) -> Figure:
    """A panel for each state, true and estimated."""
    figure = Figure(figsize=(12, 6), layout="constrained")
    axes = figure.subplots(2, 3, sharex=True).T.reshape(6)
    first = next(iter(trials.values()))
    time = STEP * np.arange(len(first.force))
    for i, (axis, state) in enumerate(zip(axes, STATES)):
        for (name, trial), colour in zip(trials.items(), COLOURS):
            axis.plot(time, trial.mean[:, i], color=colour, lw=1.2, label=name if i == 0 else None)
        axis.plot(time, first.state[:, i], color="black", lw=1.2, ls="--", label="true" if i == 0 else None)
        axis.set_title(state + ("" if i < 3 else ", not measured"), fontsize=10)
        axis.spines[["top", "right"]].set_visible(False)
    for axis in axes[1::2]:
        axis.set_xlabel("time [s]")
    figure.legend(loc="outside right center", frameon=False)
    return figure
