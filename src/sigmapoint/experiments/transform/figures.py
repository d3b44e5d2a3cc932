"""Figures of the transform experiment: a curve with densities on its axes, clouds with ellipses, errors by width."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

COLOURS = {"truth": "black", "linearised": "#c44e00", "UT": "#0072b2", "CDKF": "#009e73", "cubature": "#cc79a7",
           "simplex": "#b8860b", "GH(3)": "#56b4e9", "GH(5)": "#6a3d9a"}  # fmt: skip
DASHES = {"truth": "-", "linearised": ":", "UT": "--", "CDKF": "--"}
MARKS = {"linearised": "o", "UT": "s", "CDKF": "D", "cubature": "v", "simplex": "^", "GH(3)": "P", "GH(5)": "*"}
INSIDE_95 = np.sqrt(5.991)
"""Radius, in standard deviations, of the circle that holds 95 % of a Gaussian in the plane."""
CLOUD = "0.72"


class Gaussian2(NamedTuple):
    """A Gaussian to draw: mean and covariance."""

    mean: np.ndarray
    cov: np.ndarray


class Clouds(NamedTuple):
    """A prior and what became of it: samples, Gaussians by method, and sigma points with their images."""

    prior: Gaussian2
    before: np.ndarray
    after: np.ndarray
    gaussians: Mapping[str, Gaussian2]
    points: np.ndarray
    images: np.ndarray


def curve(name: str, x: np.ndarray, y: np.ndarray, clouds: Clouds) -> Figure:
    """A function of one variable (values `y` at `x`), the prior's density below, those of its value on the left."""
    figure = Figure(figsize=(9, 6.5), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1, 2), height_ratios=(2.4, 1))
    main = figure.add_subplot(grid[0, 1])
    left = figure.add_subplot(grid[0, 0], sharey=main)
    below = figure.add_subplot(grid[1, 1], sharex=main)
    mean, std = clouds.prior.mean[0], np.sqrt(clouds.prior.cov[0, 0])
    main.plot(x, y, color="black", label=f"y = {name}")
    tangent = clouds.gaussians["linearised"]
    slope = np.sqrt(tangent.cov[0, 0]) / std
    main.plot(x, tangent.mean[0] + slope * (x - mean), color=COLOURS["linearised"], ls=":", label="tangent at the mean")
    main.plot(clouds.points[:, 0], clouds.images[:, 0], "o", color=COLOURS["CDKF"], ms=8, label="sigma points")
    main.legend(frameon=False, loc="upper left")
    below.fill_between(x, _density(x, mean, std), color=CLOUD, lw=0)
    below.plot(clouds.points[:, 0], np.zeros(len(clouds.points)), "o", color=COLOURS["CDKF"], ms=8, clip_on=False)
    below.set_xlabel(f"x, Gaussian with mean {mean:g} and standard deviation {std:g}")
    below.set_ylim(0)
    left.hist(clouds.after[:, 0], bins=120, range=(y.min(), y.max()), density=True, orientation="horizontal",
              color=CLOUD, label="truth (Monte Carlo)")  # fmt: skip
    levels = np.linspace(min(y.min(), tangent.mean[0] - 3 * slope * std), y.max(), 400)
    for method, (m, cov) in clouds.gaussians.items():
        label = "Gaussian with the true moments" if method == "truth" else method
        left.plot(
            _density(levels, m[0], np.sqrt(cov[0, 0])), levels, color=COLOURS[method], ls=DASHES[method], label=label
        )
    main.set_ylim(levels[0], levels[-1])
    main.set_xlim(x[0], x[-1])
    left.invert_xaxis()
    left.set_ylabel("y")
    left.set_xticks([])
    below.set_yticks([])
    for axis in (main, below):
        axis.tick_params(labelleft=False)
    main.tick_params(labelbottom=False)
    figure.legend(*left.get_legend_handles_labels(), loc="lower left", frameon=False)
    return figure


def _density(x: np.ndarray, mean: float, std: float) -> np.ndarray:
    return np.exp(-0.5 * ((x - mean) / std) ** 2) / (std * np.sqrt(2 * np.pi))


def ellipses(cases: Mapping[str, Clouds]) -> Figure:
    """For each function of two variables (a row): the prior; its image with ellipses that should hold 95 %."""
    figure = Figure(figsize=(10, 4.6 * len(cases)), layout="constrained")
    axes = figure.subplots(len(cases), 2, squeeze=False)
    for (before, after), (name, clouds) in zip(axes, cases.items()):
        before.plot(*clouds.before.T, ".", color=CLOUD, ms=2, rasterized=True)
        _ellipse(before, "truth", clouds.prior)
        before.plot(*clouds.points.T, "s", color=COLOURS["UT"], ms=6)
        before.set_title(f"{name}: prior and sigma points")
        after.plot(*clouds.after.T, ".", color=CLOUD, ms=2, rasterized=True)
        for method, gaussian in clouds.gaussians.items():
            _ellipse(after, method, gaussian)
        after.plot(*clouds.images.T, "s", color=COLOURS["UT"], ms=4, mfc="none", label="images of the sigma points")
        after.set_title("image, mean and 95 % ellipse")
        after.legend(frameon=False, loc="best", fontsize=9)
        for axis, letter in ((before, "x"), (after, "y")):
            axis.set_xlabel(f"{letter}₁")
            axis.set_ylabel(f"{letter}₂")
    return figure


def _ellipse(axis: Axes, method: str, gaussian: Gaussian2) -> None:
    angle = np.linspace(0, 2 * np.pi, 181)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    edge = gaussian.mean[:, None] + INSIDE_95 * np.linalg.cholesky(gaussian.cov) @ circle
    axis.plot(*edge, color=COLOURS[method], ls=DASHES[method], lw=2, label=method)
    axis.plot(*gaussian.mean, "+", color=COLOURS[method], ms=12, mew=2)


class Line(NamedTuple):
    """Errors of a rule as the prior narrows, and the order fitted to them (NaN where there was too little to fit)."""

    widths: np.ndarray
    errors: np.ndarray
    order: float
    spread: float


def orders(panels: Mapping[str, Mapping[str, Line]], columns: int) -> Figure:
    """Errors against the width of the prior, a panel for each function and moment, with the fitted orders."""
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(6 * columns, 3.8 * rows), layout="constrained")
    for i, (title, lines) in enumerate(panels.items()):
        axis = figure.add_subplot(rows, columns, i + 1)
        for size, (method, line) in zip(range(8, 0, -1), lines.items()):  # smaller and smaller: lines may coincide
            label = f"{method}: {line.order:.1f}" if np.isfinite(line.order) else method
            style = {"marker": MARKS[method], "color": COLOURS[method], "ls": DASHES.get(method, "-")}
            axis.loglog(line.widths, line.errors, ms=0.8 * size + 1, lw=1, label=label, **style)
        axis.set_title(title)
        axis.legend(title="order", frameon=False, fontsize=9, loc="center left", bbox_to_anchor=(1, 0.5))
        axis.set_ylabel("error")
        axis.set_xlabel("width of the prior, as a share of the one drawn")
    return figure
