"""Figures of terrain-aided navigation: a belief over time as a ridge of densities, and errors over time."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from sigmapoint.experiments.terrain.runs import Belief
from sigmapoint.problems import terrain

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#555555", "#8c6d31", "#17becf", "#7b4ea3")
FAINT = ("#86cfae", "#e3b9d0")
FILLED, LINE, TRUE = COLOURS[0], COLOURS[1], "black"
SHOWN = 16
"""instants in a ridge"""
VIEW = 6000.0
"""[m] to either side of dead reckoning"""
SMOOTH = 90.0
"""[m] standard deviation of the kernel that densities are drawn with"""
HEIGHT = 1.5
"""of the highest curve, in distances from one curve to the next"""


class Flight(NamedTuple):
    """One flight, and what two filters believe of it."""

    x: Float[np.ndarray, " T"]
    """[m] true positions"""
    y: Float[np.ndarray, " T"]
    """[m] heights"""
    other: float
    """[m] from the true position to the other hypothesis"""
    filled: tuple[str, Belief]
    line: tuple[str, Belief]


def ridge(flight: Flight) -> Figure:
    """Densities of the position, one above the other as time passes; the ground that was flown over below."""
    figure = Figure(figsize=(11, 10.5), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=(5, 2))
    _densities(above, flight)
    _ground(below, flight)
    return figure


def _densities(axis: Any, flight: Flight) -> None:
    T = len(flight.x)
    reckoned = terrain.SPEED * terrain.STEP * np.arange(T)
    at = np.linspace(-VIEW, VIEW, 801)
    instants = np.unique(np.linspace(0, T - 1, SHOWN).round().astype(int))
    apart = terrain.STEP * (T - 1) / (SHOWN - 1)
    for k in instants[::-1]:
        filled, line = (_density(belief, k, reckoned[k] + at) for _, belief in (flight.filled, flight.line))
        scale, base, first = HEIGHT * apart / filled.max(), terrain.STEP * k, k == 0
        order = 3 * (T - k)
        axis.fill_between(at / 1000, base, base + scale * filled, color="white", lw=0, zorder=order)
        axis.fill_between(at / 1000, base, base + scale * filled, color=FILLED, alpha=0.35, lw=0, zorder=order)
        axis.plot(at / 1000, base + scale * filled, color=FILLED, lw=1.1, zorder=order + 1,
                  label=flight.filled[0] if first else None)  # fmt: skip
        axis.plot(at / 1000, base + scale * line, color=LINE, lw=1.3, zorder=order + 1,
                  label=flight.line[0] if first else None)  # fmt: skip
    axis.plot((flight.x - reckoned)[instants] / 1000, terrain.STEP * instants, "v", color=TRUE, ms=5, zorder=4 * T,
              label="true position")  # fmt: skip
    axis.set_xlim(-VIEW / 1000, VIEW / 1000)
    axis.set_ylim(-apart / 2, terrain.STEP * (T - 1) + (HEIGHT + 0.4) * apart)
    axis.set_yticks(np.arange(0, terrain.STEP * T + 1, 30))
    axis.set_xlabel("position, from where dead reckoning has it [km]")
    axis.set_ylabel("time [s]")
    axis.legend(frameon=False, loc="lower left", bbox_to_anchor=(0, 1), ncols=3, borderaxespad=0.2)
    axis.spines[["top", "right"]].set_visible(False)


def _density(belief: Belief, k: int, at: Float[np.ndarray, " G"]) -> Float[np.ndarray, " G"]:
    """[1/m] at instant k, smooth enough to be seen."""
    place, log_weight, std = (np.broadcast_to(part[k], (len(at), part[k].size)) for part in belief)
    return np.exp(Belief(place, log_weight, np.hypot(std, SMOOTH)).log_density(at))


def _ground(axis: Any, flight: Flight) -> None:
    other = flight.x + flight.other
    low, high = min(flight.x[0], other[0]) - 500, max(flight.x[-1], other[-1]) + 500
    p = np.linspace(low, high, 1200)
    ground = np.asarray(terrain.height(p))
    bottom = ground.min() - 15
    axis.fill_between(p / 1000, bottom, ground, color="0.88", lw=0)
    axis.plot(p / 1000, ground, color="0.45", lw=1, label="terrain")
    axis.plot(other / 1000, flight.y, "o", color=LINE, ms=3, mfc="none", mew=0.8,
              label="heights measured, drawn where the other hypothesis has the aircraft")  # fmt: skip
    axis.plot(flight.x / 1000, flight.y, "o", color=TRUE, ms=2.5, label="heights measured, at the true position")
    axis.set_xlim(low / 1000, high / 1000)
    axis.set_ylim(bottom, None)
    axis.set_xlabel("position along the track [km]")
    axis.set_ylabel("height [m]")
    axis.legend(frameon=False, loc="lower left", bbox_to_anchor=(0, 1), ncols=3, borderaxespad=0.2, handletextpad=0.3)
    axis.spines[["top", "right"]].set_visible(False)


def errors(panels: Mapping[str, Mapping[str, Float[np.ndarray, " T"]]], reference: tuple[str, np.ndarray]) -> Figure:
    """Errors [m] over time, a panel for each kind of filter."""
    figure = Figure(figsize=(11, 5.2), layout="constrained")
    axes = figure.subplots(1, len(panels), sharex=True, sharey=True)
    t = terrain.STEP * np.arange(terrain.STEPS)
    for axis, (title, curves) in zip(axes, panels.items()):
        axis.plot(t, reference[1], color="black", lw=1.4, ls="--", label=reference[0])
        for (name, error), colour in zip(curves.items(), COLOURS + FAINT):
            axis.plot(t, error, color=colour, lw=1.3, label=name)
        axis.set_yscale("log")
        axis.set_title(title, fontsize=11)
        axis.set_xlabel("time [s]")
        axis.grid(color="0.92")
        axis.margins(x=0.01)
        axis.spines[["top", "right"]].set_visible(False)
        axis.legend(frameon=False, fontsize=8.5, loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=3)
    axes[0].set_ylabel("error of the position, rms over the flights [m]")
    return figure
