"""The profile of a likelihood: one parameter held, the others at their best.

Where measurements leave a parameter open, or its likelihood leans to one side, the profile shows it. It falls by
BAR²/2 at the ends of an interval of BAR standard deviations, in whatever units.

Source: Pawitan, "In All Likelihood" (2001), section 3.4.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from sigmapoint import checks
from sigmapoint.contents import Contents, Curve, Panel, Section
from sigmapoint.identification.estimates import BAR


class Profile(NamedTuple):
    """The largest log-likelihood that is left where one parameter is held."""

    name: str
    value: Float[np.ndarray, " P"]
    """of the parameter, in its own units"""
    log_likelihood: Float[np.ndarray, " P"]
    """with the prior's part, where the fit had one"""
    best: float
    """of the fit"""

    @property
    def interval(self) -> tuple[float, float]:
        """Where the log-likelihood is 2 below its highest: two deviations of a Gaussian; NaN where it is not."""
        peak = int(np.argmax(self.log_likelihood))
        fall = np.sqrt(2 * np.maximum(max(self.best, self.log_likelihood[peak]) - self.log_likelihood, 0.0))
        return _crossing(fall[peak::-1], self.value[peak::-1]), _crossing(fall[peak:], self.value[peak:])

    def contents(self) -> Contents:
        """What a page about it shows."""
        curve = Curve(self.log_likelihood - self.best, x=self.value)
        text = "The log-likelihood below its highest where one parameter is held and the others are at their best for "
        text += "it. Dotted: 2 below, where the 95 % interval ends."
        panel = Panel((curve,), self.name, "log-likelihood − best", -(BAR**2) / 2)
        return Contents({}, (Section("Profiles", text, panels={self.name: panel}),))


def _crossing(fall: np.ndarray, value: np.ndarray) -> float:
    """The first place where the fall reaches `BAR`, going out from the peak; NaN where it does not."""
    beyond = np.flatnonzero(fall > BAR)
    if not beyond.size or not beyond[0]:
        return float("nan")
    ends = slice(beyond[0] - 1, beyond[0] + 1)
    return float(np.interp(BAR, fall[ends], value[ends]))


def plot_profiles(profiles: Sequence[Profile]) -> np.ndarray:
    """Draw profiles one beside the other, with the line that cuts off the 95 % interval; returns the matplotlib axes.

    Raises:
        ImportError: matplotlib is not installed.
    """
    plt = checks.extra("matplotlib.pyplot", "plot_profiles")
    size = (0.8 + 2.6 * len(profiles), 2.6)
    _, axes = plt.subplots(1, len(profiles), sharey=True, squeeze=False, figsize=size, layout="constrained")
    for profile, ax in zip(profiles, axes[0]):
        ax.plot(profile.value, profile.log_likelihood - profile.best, lw=1.3)
        ax.axhline(-(BAR**2) / 2, ls="--", color="0.35", lw=1.1)
        for end in profile.interval:
            ax.axvline(end, ls=":", color="0.35", lw=1.1)
        ax.set_xlabel(profile.name)
        ax.grid(alpha=0.25)
        ax.spines[["top", "right"]].set_visible(False)
    axes[0, 0].set_ylabel("log-likelihood − best")
    return axes[0]
