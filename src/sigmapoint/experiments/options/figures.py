"""Figures of the options experiment: forecasts of prices, rate and volatility over days, the smile over strikes."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

COLOURS = ("#0072b2", "#d55e00")
DAYS = (52, 104, 154, 204)
"""whose smiles are drawn"""
WIDTH = 40
"""[index points] of a density, at its peak"""


def forecasts(
    prices: Float[np.ndarray, "T 2"], ahead: Float[np.ndarray, "T 2"], judged: slice, kinds: Sequence[str]
) -> Figure:
    """Prices above, errors below; a column for each kind of option."""
    figure = Figure(figsize=(12, 6), layout="constrained")
    axes = figure.subplots(2, len(kinds), sharex=True, sharey="row", height_ratios=(3, 2))
    days = np.arange(1, len(prices) + 1)
    for i, (kind, column) in enumerate(zip(kinds, axes.T)):
        column[0].plot(days, prices[:, i], color="black", lw=1, label="price")
        column[0].plot(days[1:], ahead[1:, i], ".", color=COLOURS[i], ms=4, label="a step ahead")
        column[0].legend(frameon=False)
        column[0].set_title(kind)
        column[1].plot(days[1:], np.diff(prices[:, i]), color="0.7", lw=1, label="of the price of the day before")
        column[1].plot(days[1:], (prices - ahead)[1:, i], color=COLOURS[i], lw=1, label="a step ahead")
        column[1].legend(frameon=False, ncols=2)
        column[1].set_xlabel("trading day")
        for axis in column:
            axis.axvspan(days[judged][0], days[judged][-1], color="0.95", zorder=0)
            axis.margins(x=0.01)
            axis.spines[["top", "right"]].set_visible(False)
    axes[0, 0].set_ylabel("price / strike")
    axes[1, 0].set_ylabel("error / strike")
    return figure


def states(
    found: Mapping[str, tuple[Float[np.ndarray, "T 2"], Float[np.ndarray, "T 2"]]],
    truth: tuple[Float[np.ndarray, "T"], Float[np.ndarray, "T"]] | None,
) -> Figure:
    """Rate above, volatility below; the band is of the first method."""
    figure = Figure(figsize=(10, 6), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    for i, (axis, label) in enumerate(zip(axes, ("rate r [1/year]", "volatility σ [1/√year]"))):
        for j, (name, (mean, std)) in enumerate(found.items()):
            days, middle, half = np.arange(1, len(mean) + 1), mean[:, i], 2 * std[:, i]
            axis.plot(days, middle, color=COLOURS[j], ls=("-", "--")[j], lw=1.2, label=name)
            if j == 0:
                axis.fill_between(days, middle - half, middle + half, color=COLOURS[j], alpha=0.2, lw=0, label="±2σ")
                low, high = (middle - half)[10:].min(), (middle + half)[10:].max()
                axis.set_ylim(low - 0.1 * (high - low), high + 0.2 * (high - low))
        if truth is not None:
            axis.plot(np.arange(1, len(truth[i]) + 1), truth[i], color="black", lw=1, label="truth")
        axis.set_ylabel(label)
        axis.margins(x=0.01)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].legend(frameon=False, ncols=4, loc="upper right")
    axes[1].set_xlabel("trading day")
    return figure


def smiles(
    strikes: Sequence[int],
    index: Float[np.ndarray, "T"],
    mean: Float[np.ndarray, "T K"],
    std: Float[np.ndarray, "T K"],
    truth: Float[np.ndarray, "T K"] | None,
) -> Figure:
    """Volatility over strikes on some days."""
    figure = Figure(figsize=(13, 4.2), layout="constrained")
    for axis, day in zip(figure.subplots(1, len(DAYS), sharey=True), DAYS):
        k = day - 1
        for strike, m, s in zip(strikes, mean[k], std[k]):
            _density(axis, strike, m, s)
        along = np.linspace(strikes[0], strikes[-1], 200)
        middle = np.mean(strikes)
        fitted = np.polynomial.Polynomial.fit(np.array(strikes) - middle, mean[k], 4)
        axis.plot(along, fitted(along - middle), color="0.4", lw=1, label="polynomial")
        axis.plot(strikes, mean[k], "*", color="black", ms=8, label="mean")
        if truth is not None:
            axis.plot(strikes, truth[k], "o", color=COLOURS[1], ms=5, mfc="none", label="truth")
        if strikes[0] - 50 < index[k] < strikes[-1] + 100:
            axis.axvline(index[k], color="0.6", lw=0.8, ls="--")
        axis.set_title(f"day {day}: index {index[k]:.0f}")
        axis.set_xticks(strikes, map(str, strikes), rotation=45)
        axis.set_xlabel("strike")
        axis.spines[["top", "right"]].set_visible(False)
    figure.axes[0].set_ylabel("volatility [1/√year]")
    figure.axes[0].legend(frameon=False)
    return figure


def _density(axis: Axes, strike: int, mean: float, std: float) -> None:
    """A Gaussian bell lying on its side, to the right of its strike."""
    z = np.linspace(-3, 3, 61)
    bell = strike + WIDTH * np.exp(-(z**2) / 2)
    axis.fill_betweenx(mean + std * z, strike, bell, color=COLOURS[0], alpha=0.3, lw=0)
