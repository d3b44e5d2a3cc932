"""Trials of the pendulum by a filter, and what became of them."""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.stats import ttest_1samp, wilcoxon

from sigmapoint.methods import Method
from sigmapoint.problems import pendulum_state as problem
from sigmapoint.problems.pendulum import STEP, fallen
from sigmapoint.problems.pendulum_state import Noise, Told, Trial

UPPER, UNSEEN = 4, (3, 4, 5)
ANGLES = np.array([False, False, True, False, True, False])


class Trials(NamedTuple):
    """Many trials, with what is wrong in the estimates."""

    trial: Trial
    error: Float[np.ndarray, "R T 6"]

    def at(self, i: int) -> Trial:
        """One of them."""
        return jax.tree.map(lambda a: a[i], self.trial)


class Found(NamedTuple):
    """What became of all trials, those that were only watched and those that trusted in the estimate."""

    watched: Trials
    trusted: Trials

    @property
    def down(self) -> Bool[np.ndarray, "R T"]:
        """Whether a rod has passed the horizontal by then."""
        state = self.trusted.trial.state
        return np.logical_or.accumulate(np.asarray(fallen(state)) | ~np.isfinite(state).all(2), axis=1)

    @property
    def fell(self) -> Bool[np.ndarray, " R"]:
        """Whether it has in the end."""
        return self.down[:, -1]

    @property
    def when(self) -> Float[np.ndarray, " R"]:
        """[s] of the crash; NaN in trials without one."""
        return np.where(self.fell, STEP * self.down.argmax(1), np.nan)

    @property
    def error(self) -> Float[np.ndarray, "R 3"]:
        """Of each unseen state, root mean square over a trial that is only watched; NaN where an estimate is none."""
        return np.sqrt((self.watched.error**2).mean(1))[:, UNSEEN]

    @property
    def lost(self) -> Bool[np.ndarray, " R"]:
        """Whether the upper rod's direction is more than 90° off at some time of a trial that is only watched."""
        return np.any(~(np.abs(self.watched.error[:, :, UPPER]) < np.pi / 2), axis=1)


class Runner:
    """A filter with its programs, compiled once for all levels of noise."""

    def __init__(self, method: Method, start: Float[Array, "R 6"], noise: Noise, known: Trial) -> None:
        def watched(told: Told, sensors: Array, trial: Trial, noise: Noise) -> Trial:
            return problem.watched(method, told, sensors, trial, noise)

        def trusted(told: Told, sensors: Array, start: Array, noise: Noise) -> Trial:
            return problem.trusted(method, told, sensors, start, noise)

        self.start, self.noise, self.known = start, noise, known
        self._watched, self._trusted = (jax.jit(jax.vmap(f, (None, None, 0, 0))) for f in (watched, trusted))

    def found(self, told: Told, sensors: Float[np.ndarray, " 3"]) -> Found:
        """All trials, with noises of these standard deviations [m, m/s, rad]."""
        given = told, jnp.asarray(sensors)
        watched: Any = self._watched(*given, self.known, self.noise)
        return outcome(watched, self._trusted(*given, self.start, self.noise))


def outcome(watched: Trial, trusted: Trial) -> Found:
    """Of trials."""
    return Found(_judged(watched), _judged(trusted))


def _judged(trial: Trial) -> Trials:
    trial = jax.tree.map(np.asarray, trial)
    off = trial.mean - trial.state
    return Trials(trial, np.where(ANGLES, (off + np.pi) % (2 * np.pi) - np.pi, off))


def by_ranks(differences: Float[np.ndarray, " R"]) -> float:
    """The p-value of a median of zero, by Wilcoxon's signed ranks: a few large differences do not decide."""
    kept = differences[np.isfinite(differences)]
    return np.asarray(wilcoxon(kept))[1].item() if kept.any() else math.nan


def p_value(differences: Float[np.ndarray, " R"]) -> float:
    """That of a mean of zero, by Student's t."""
    kept = differences[np.isfinite(differences)]
    return np.asarray(ttest_1samp(kept, 0.0))[1].item() if kept.size > 1 and np.ptp(kept) > 0 else math.nan
