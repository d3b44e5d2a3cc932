"""Figures of learning experiments."""

import itertools
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")


def learning(
    found: Mapping[str, Float[np.ndarray, "R E"]], floor: float | None, what: str, per: str = "epoch"
) -> Figure:
    """Mean over runs against epochs, with a band of one standard error; square roots dashed over their dense form."""
    figure = Figure(figsize=(9, 5), layout="constrained")
    axis = figure.subplots()
    families = list(dict.fromkeys(_family(name) for name in found))
    variants = itertools.cycle((":", "-.", (0, (1, 4))))
    for name, runs in found.items():
        epochs, mean = np.arange(1, runs.shape[1] + 1), runs.mean(0)
        error = runs.std(0, ddof=1) / len(runs) ** 0.5
        colour = COLOURS[families.index(_family(name)) % len(COLOURS)]
        root = name.startswith("SR-")
        style = next(variants) if "," in name else ("--" if root else "-")
        under = f"SR-{name}" in found
        axis.plot(epochs, mean, ls=style, color=colour, lw=3 if under else 1.5, alpha=0.45 if under else 1, label=name)
        axis.fill_between(epochs, mean - error, mean + error, color=colour, alpha=0.12, lw=0)
    if floor is not None:
        axis.axhline(floor, color="black", lw=0.8, ls=":")
        axis.annotate("noise", (1, floor), xytext=(0, 3), textcoords="offset points", fontsize=9)
    axis.set_yscale("log")
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    axis.set_xlabel(per)
    axis.set_ylabel(what)
    axis.spines[["top", "right"]].set_visible(False)
    axis.legend(frameon=False, ncols=2)
    return figure


def maps(regions: Mapping[str, Int[np.ndarray, "side side"]], columns: int) -> Figure:
    """Which class is where in the square [−1, 1]², a picture each, in rows."""
    rows = -(-len(regions) // columns)
    figure = Figure(figsize=(2.6 * columns, 2.9 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in axes:
        axis.set_axis_off()
    for axis, (name, classes) in zip(axes, regions.items()):
        axis.imshow(classes, ListedColormap(COLOURS), vmin=-0.5, vmax=3.5, origin="lower", extent=(-1, 1, -1, 1))
        axis.set_title(name, fontsize=11)
    return figure


def _family(name: str) -> str:
    return name.removeprefix("SR-").split(",")[0]
