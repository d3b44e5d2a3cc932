"""States and parameters with their error bars, as matplotlib axes."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sigmapoint import checks
from sigmapoint.checks import data_checks
from sigmapoint.contents import Panel
from sigmapoint.curves import broken, principal, wraps
from sigmapoint.results import Posterior, field
from sigmapoint.tables import instants

SHOWN = 12
"""States or parameters drawn, at most."""
BAND = "95 % band"


def plot_states(post: Posterior, time: Any = None, truth: Any = None) -> np.ndarray:
    """Draw each state with its ±2σ band, one below the other; the first 12 of many.

    Args:
        post: the result of one series.
        time: instants (T,), numbers or dates; 0, 1, 2, … where not given.
        truth: true states (T, n), drawn as dashed lines.

    Returns:
        The matplotlib axes, an array with one for each state drawn.

    Raises:
        ValueError: `time` or `truth` of another shape; a batch of results; `mean` or `std` not kept.
        ImportError: matplotlib is not installed.
    """
    mean, std = field(post, "mean"), field(post, "std")
    T, n = mean.shape
    x = instants(time, T)
    space = post.labels.state_space
    true = None if truth is None else principal(space, data_checks.truth(truth, mean.shape))
    drawn = min(n, SHOWN)
    axes = _stacked(drawn)
    for i, ax in enumerate(axes):
        breaks = wraps(space, mean, i)
        if std.shape == mean.shape:
            low, high = mean[:, i] - 2 * std[:, i], mean[:, i] + 2 * std[:, i]
            ax.fill_between(*broken(breaks, x, low, high), alpha=0.25, lw=0, label="±2σ")
        ax.plot(*broken(breaks, x, mean[:, i]), lw=1.3, label="estimate")
        if true is not None:
            ax.plot(*broken(wraps(space, true, i), x, true[:, i]), "--", color="0.35", lw=1.1, label="truth")
        ax.set_ylabel(titled(post.labels.states[i], post.labels.state_units[i]))
    axes[-1].set_xlabel("sample" if time is None else "time")
    _finished(axes, n, "states")
    return axes


def plot_panels(panels: Mapping[str, Panel], x: np.ndarray | None = None, axis: str = "") -> np.ndarray:
    """Draw panels one below the other; the first 12 of many.

    Args:
        panels: by what is drawn.
        x: instants, of curves that have no place of their own.
        axis: what those are.

    Returns:
        The matplotlib axes, an array with one for each panel drawn.

    Raises:
        ImportError: matplotlib is not installed.
    """
    axes = _stacked(min(len(panels), SHOWN))
    for (name, panel), ax in zip(panels.items(), axes):
        for curve in panel.curves:
            at = x if curve.x is None else curve.x
            if curve.low is not None and curve.high is not None:
                ax.fill_between(at, curve.low, curve.high, alpha=0.25, lw=0, label=BAND)
            ax.plot(at, curve.y, lw=1.3, label=curve.name or "estimate")
        ax.set_ylabel(name)
    axes[-1].set_xlabel(next(iter(panels.values())).axis or axis)
    _finished(axes, len(panels), "parameters")
    return axes


def _stacked(count: int) -> np.ndarray:
    plt = checks.extra("matplotlib.pyplot", "plot")
    size = (8, 1.2 + 1.7 * count)
    return plt.subplots(count, 1, sharex=True, squeeze=False, figsize=size, layout="constrained")[1][:, 0]


def _finished(axes: np.ndarray, total: int, what: str) -> None:
    """With a legend where there are bands, and a word where not all are drawn."""
    figure = axes[0].figure
    handles, labels = axes[0].get_legend_handles_labels()
    if len(handles) > 1:
        figure.legend(handles, labels, loc="outside upper right", ncols=3, frameon=False)
    if total > len(axes):
        figure.suptitle(f"the first {len(axes)} of {total} {what}", x=0.01, ha="left", fontsize="medium")
    for ax in axes:
        ax.grid(alpha=0.25)
        ax.spines[["top", "right"]].set_visible(False)


def titled(name: str, unit: str) -> str:
    """`voltage [V]`; the name alone for a number without a unit."""
    return f"{name} [{unit}]" if unit not in ("", "1") else name
