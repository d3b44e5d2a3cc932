"""What is learned of the double inverted pendulum from its falls: the five parameters, run by run and fall by fall."""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import sigmapoint as sp
from sigmapoint.experiments.learning.curves import Lessons, curves, for_each, squared_error
from sigmapoint.learning.drift import Drift
from sigmapoint.learning.learner import Learner, LearnerState
from sigmapoint.methods import Method
from sigmapoint.problems.pendulum import TRUTH, Parameters, moved
from sigmapoint.problems.pendulum_falls import LONGEST, Falls, drawn

MASSES = np.array(TRUTH[2:])
TEST = 400
"""pairs"""


class Way(NamedTuple):
    """A method, and what it learns: numbers, zeros at the start, that stand for the parameters."""

    method: Method
    note: str
    decoded: Callable[[Any], Any] = lambda w: 1 + w


class Setting(NamedTuple):
    """What a learner is told."""

    noise: float = 0.1
    """[m, m/s, rad, rad/s] standard deviation of each element of the next state"""
    drift: Drift = sp.on_diagonal(sp.robbins_monro(1e-4, 0.01))
    prior: float = 1.0
    """[m, kg] standard deviation"""


class Learned(NamedTuple):
    """One row a run, one column a fall."""

    error: Float[np.ndarray, "R E"]
    """mean squared error of an element of the next state, on falls that were not learned from"""
    parameters: Float[np.ndarray, "R E 5"]

    @property
    def factor(self) -> Float[np.ndarray, " R"]:
        """What the learned masses are, in the end, of the true ones."""
        return self.parameters[:, -1, 2:] @ MASSES / (MASSES @ MASSES)

    @property
    def worst(self) -> Float[np.ndarray, " R"]:
        """[%] largest error of the five parameters, of the true value."""
        return _percent(self.parameters[:, -1])

    @property
    def worst_visible(self) -> Float[np.ndarray, " R"]:
        """[%] likewise, of the lengths, and of the masses without their common factor."""
        w = self.parameters[:, -1]
        return _percent(np.concatenate([w[:, :2], w[:, 2:] / self.factor[:, None]], axis=1))


def _percent(w: Float[np.ndarray, "R 5"]) -> Float[np.ndarray, " R"]:
    return 100 * np.abs(w / np.array(TRUTH) - 1).max(axis=1)


def tested(force: float, key: Array) -> tuple[Array, Array]:
    """Pairs without disturbances."""
    falls = drawn(TEST // 10, force, 0.0, key)
    return falls.before[falls.there][:TEST], falls.after[falls.there][:TEST]


def learned(way: Way, setting: Setting, runs: int, falls: Falls, test: tuple[Array, Array]) -> Learned:
    """Every run from falls of its own."""
    noise, drift, prior = setting
    function = prediction(way.decoded)
    learner = sp.learner(function, jnp.zeros(5), noise=noise**2, method=way.method, drift=drift, prior_std=prior)
    train = falls.before.reshape(-1, 7), falls.after.reshape(-1, 6)
    order = jnp.where(falls.there.ravel(), jnp.arange(len(train[0])), -1).reshape(runs, -1, LONGEST)
    scores = curves(learner, Lessons(jnp.zeros((runs, 5)), order, for_each(runs, test)), train, _score).test
    return Learned(scores[:, :, 0], np.asarray(way.decoded(scores[:, :, 1:])))


@cache
def prediction(decoded: Callable[[Any], Any]) -> Callable[[Array, Array], Array]:
    """The next state by what is learned; the same function each time, so that it is compiled once."""
    return lambda w, x: moved(Parameters(*decoded(w)), x[:6], x[6])


def _score(learner: Learner, state: LearnerState, test: tuple[Array, Array]) -> Float[Array, " 6"]:
    return jnp.append(squared_error(learner, state, test), state.mean)
