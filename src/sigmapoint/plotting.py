"""States with their error bars, as matplotlib axes."""

from typing import Any

import numpy as np

from sigmapoint import checks, data_checks
from sigmapoint.curves import broken, principal, wraps
from sigmapoint.results import Posterior, field
from sigmapoint.tables import instants

SHOWN = 12
"""States drawn, at most."""


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
    plt = checks.extra("matplotlib.pyplot", "plot")
    mean, std = field(post, "mean"), field(post, "std")
    T, n = mean.shape
    x = instants(time, T)
    space = post.labels.state_space
    true = None if truth is None else principal(space, data_checks.truth(truth, mean.shape))
    drawn = min(n, SHOWN)
    figure, axes = plt.subplots(
        drawn, 1, sharex=True, squeeze=False, figsize=(8, 1.2 + 1.7 * drawn), layout="constrained"
    )
    for i, ax in enumerate(axes[:, 0]):
        breaks = wraps(space, mean, i)
        if std.shape == mean.shape:
            low, high = mean[:, i] - 2 * std[:, i], mean[:, i] + 2 * std[:, i]
            ax.fill_between(*broken(breaks, x, low, high), alpha=0.25, lw=0, label="±2σ")
        ax.plot(*broken(breaks, x, mean[:, i]), lw=1.3, label="estimate")
        if true is not None:
            ax.plot(*broken(wraps(space, true, i), x, true[:, i]), "--", color="0.35", lw=1.1, label="truth")
        ax.set_ylabel(titled(post.labels.states[i], post.labels.state_units[i]))
        ax.grid(alpha=0.25)
        ax.spines[["top", "right"]].set_visible(False)
    axes[-1, 0].set_xlabel("sample" if time is None else "time")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=3, frameon=False)
    if n > drawn:
        figure.suptitle(f"the first {drawn} of {n} states", x=0.01, ha="left", fontsize="medium")
    return axes[:, 0]


def titled(name: str, unit: str) -> str:
    """`voltage [V]`; the name alone for a number without a unit."""
    return f"{name} [{unit}]" if unit not in ("", "1") else name
