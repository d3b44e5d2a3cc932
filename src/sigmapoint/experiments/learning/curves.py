"""Learning curves: one function trained from many starts, in epochs, with a score on a test set after each."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sigmapoint.learning.learner import Learner
from sigmapoint.learning.state import LearnerState
from sigmapoint.learning.update import updated

Score = Callable[[Learner, LearnerState, Any], Array]
"""of a state on a test set: a number, or several"""


class Curves(NamedTuple):
    """One row a run, one column an epoch."""

    test: Float[np.ndarray, "R E *scores"]
    """score on the test set after the epoch"""
    nis: Float[np.ndarray, "R E"]
    """mean NIS of an element over the epoch"""
    mean: Float[np.ndarray, "R L"]
    """the parameters in the end"""


def squared_error(learner: Learner, state: LearnerState, test: tuple[Any, Array]) -> Float[Array, ""]:
    """Mean squared error of an element."""
    return jnp.mean((learner.setup.values(state.mean, test[0]) - test[1]) ** 2)


def curves(
    learner: Learner,
    starts: Float[Array, "R L"],
    train: tuple[Any, Any],
    orders: Int[Array, "R E N"],
    test: Any,
    score: Score = squared_error,
) -> Curves:
    """Train from every start, each in its own order of the training pairs; −1 stands for none."""
    return Curves(*map(np.asarray, _curves(learner, starts, learner.setup.checked(*train), orders, test, score)))


def orders(runs: int, epochs: int, rows: int, key: Array) -> Int[Array, "R E N"]:
    """An order of the training pairs for every run and epoch."""
    keys = jax.random.split(key, (runs, epochs))
    return jax.vmap(jax.vmap(lambda k: jax.random.permutation(k, rows)))(keys)


def once(runs: int, epochs: int, rows: int) -> Int[Array, "R E N"]:
    """An order that takes runs × epochs × rows pairs once each: new ones for every run and epoch."""
    return jnp.arange(runs * epochs * rows).reshape(runs, epochs, rows)


@eqx.filter_jit
def _curves(
    learner: Learner, starts: Array, train: Any, orders: Array, test: Any, score: Score
) -> tuple[Array, Array, Array]:
    def run(given: tuple[Array, Array]) -> tuple[Array, Array, Array]:
        mean, order = given

        def epoch(state: Any, rows: Array) -> Any:
            def learned(state: Any, row: Array) -> Any:
                state, info = updated(learner.setup, state, *jax.tree.map(lambda a: a[row][None], train))
                return state, info.nis / info.prediction.shape[0]

            def step(state: Any, row: Array) -> Any:
                return jax.lax.cond(row < 0, lambda s, _: (s, jnp.zeros_like(s.mean[0])), learned, state, row)

            state, nis = jax.lax.scan(step, state, rows)
            return state, (score(learner, state, test), nis.mean(where=rows >= 0))

        state, (test_scores, nis) = jax.lax.scan(epoch, learner.init()._replace(mean=mean), order)
        return test_scores, nis, state.mean

    return jax.lax.map(run, (starts, orders))
