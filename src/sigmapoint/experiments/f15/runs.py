"""Runs of the F-15: flights side by side through a filter, and what is made of them, flight by flight.

Side by side, the points of all flights go to the simulator in one call, shared out to its processes.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import sigmapoint as sp
from sigmapoint.blackbox import unwrapped
from sigmapoint.identification.estimates import Estimates
from sigmapoint.identification.unknowns import Unknowns
from sigmapoint.methods import Method
from sigmapoint.problems import f15
from sigmapoint.problems.f15_mission import LEFT, Flight
from sigmapoint.problems.f15_simulator import STEP, Input
from sigmapoint.step import Filter

WITHIN = round(10.0 / STEP)
"""steps after the failure in which it should be found"""
CLOSE = 0.1
"""of the estimate to what is left of the stabilator"""
ALARM = 0.8
"""a failure is reported when the 95 % interval of the stabilator's effect is below this"""
SETTLED = round(10.0 / STEP)
"""steps until what is known at first is of no account"""


class Beliefs(NamedTuple):
    """Of R flights, at T instants, about n states."""

    mean: Float[Any, "*R T n"]
    std: Float[Any, "*R T n"]
    speed_std: Float[Any, "*R T"]
    """[m/s] of the size of the velocity through the air, to first order"""

    @property
    def factors(self) -> Estimates:
        """Of the factors, which are the states after the twelve."""
        return Estimates.of(Unknowns.of(f15.THETA), jnp.asarray(self.mean[..., 12:]), jnp.asarray(self.std[..., 12:]))


class Tracker:
    """A filter for several flights side by side; compiled once for each number of them."""

    def __init__(self, model: sp.StateSpaceModel, method: Method):
        self._run = Filter.of(model, method)
        self._first = self._run.init()
        self._step = jax.jit(jax.vmap(self._both))

    def __call__(self, y: Float[np.ndarray, "R T 12"], u: Input) -> Beliefs:
        """Beliefs given the measurements up to each instant."""
        ahead = jax.tree.map(lambda a: jnp.broadcast_to(a, (len(y), *a.shape)), self._first)
        every = []
        for k in range(y.shape[1]):
            ahead, belief = unwrapped(self._step, ahead, *jax.tree.map(lambda a, k=k: jnp.asarray(a[:, k]), (y, u)))
            every.append(belief)
        return jax.tree.map(lambda *each: np.stack(each, axis=1), *every)

    def _both(self, ahead: Any, y: Array, u: Input) -> tuple[Any, Beliefs]:
        now, _ = self._run.update(ahead, y, u)
        along = now.mean[3:6] / jnp.linalg.norm(now.mean[3:6])
        belief = Beliefs(now.mean, now.std, jnp.sqrt(along @ now.cov[3:6, 3:6] @ along))
        return self._run.predict(now, u), belief


class Tracked(NamedTuple):
    """Errors over bars, and errors over the noise of the measurements, by name of the state; one number a flight."""

    inside: dict[str, np.ndarray]
    """share of the time within two standard deviations"""
    error: dict[str, np.ndarray]
    """rms, over the standard deviation of the measurement's noise"""


STATES = {"altitude": 2, "roll": 6, "pitch": 7, "heading": 8, "pitch rate": 10}
"""and where they are in a state"""


def tracked(beliefs: Beliefs, state: Float[np.ndarray, "R T 12"], noise: Float[np.ndarray, " 12"]) -> Tracked:
    """How well states are known."""
    off = beliefs.mean[..., :12] - state
    speed = np.linalg.norm(beliefs.mean[..., 3:6], axis=-1) - np.linalg.norm(state[..., 3:6], axis=-1)
    inside = {name: np.abs(off[..., i]) < 2 * beliefs.std[..., i] for name, i in STATES.items()}
    inside["speed"] = np.abs(speed) < 2 * beliefs.speed_std
    error = {name: np.sqrt((off[..., i] ** 2).mean(axis=1)) / noise[i] for name, i in STATES.items()}
    return Tracked({name: share.mean(axis=1) for name, share in inside.items()}, error)


class Found(NamedTuple):
    """What is known of stabilator and lift; one number a flight."""

    before: np.ndarray
    """mean estimate of the stabilator's effect before the failure, once settled"""
    after: np.ndarray
    """its estimate ten seconds after the failure"""
    reached: np.ndarray
    """[s] from the failure until it is first close to what is left"""
    in_time: np.ndarray
    """1 where that is within ten seconds"""
    alarm: np.ndarray
    """[s] from the failure until it is reported; NaN where it is not"""
    false: np.ndarray
    """1 where one is reported before"""
    kept: np.ndarray
    """share of the time from ten seconds after the failure on in which it is close"""
    inside: np.ndarray
    """share of the time in its 95 % interval, once settled, without the ten seconds after the failure"""
    lift: np.ndarray
    """rms error of the factor of lift, once settled"""
    lift_inside: np.ndarray
    """share of the time in its 95 % interval"""


def found(beliefs: Beliefs, flight: Flight, failure: int) -> Found:
    """How well the failure is found; it is at step `failure`."""
    known = beliefs.factors
    value, low, high = (np.asarray(part.stabilator) for part in (known.value, known.low, known.high))
    close = np.abs(value - LEFT) < CLOSE
    reported = high < ALARM
    steady = np.r_[SETTLED:failure, failure + WITHIN : value.shape[1]]
    lift = np.asarray(known.value.lift)
    lift_inside = (np.asarray(known.low.lift) < 1) & (np.asarray(known.high.lift) > 1)
    reached = _first(close[:, failure:])
    return Found(
        before=value[:, SETTLED:failure].mean(axis=1),
        after=value[:, failure + WITHIN],
        reached=reached,
        in_time=1.0 * (reached <= WITHIN * STEP),
        alarm=_first(reported[:, failure:]),
        false=reported[:, :failure].any(axis=1).astype(float),
        kept=close[:, failure + WITHIN :].mean(axis=1),
        inside=((low < flight.stabilator) & (flight.stabilator < high))[:, steady].mean(axis=1),
        lift=np.sqrt(((lift - 1) ** 2)[:, SETTLED:].mean(axis=1)),
        lift_inside=lift_inside.mean(axis=1),
    )


def _first(true: np.ndarray) -> np.ndarray:
    """[s] until it first is; NaN where it never is."""
    return np.where(true.any(axis=1), STEP * true.argmax(axis=1), np.nan)
