"""Learning curves: one function trained many times, in epochs, with a score on a test set after each."""

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


class Lessons(NamedTuple):
    """What each run starts from, is taught and is tested on; a leading axis of runs."""

    start: Float[Array, "R L"]
    order: Int[Array, "R E N"]
    """Rows of the training pairs; −1 stands for none."""
    test: Any


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


def curves(learner: Learner, lessons: Lessons, train: tuple[Any, Any], score: Score = squared_error) -> Curves:
    """Train every run on its rows of the training pairs, in their order."""
    return Curves(*map(np.asarray, _curves(learner, lessons, learner.setup.checked(*train), score)))


def taught(
    pairs: tuple[Array, Array], rows: int, starts: Float[Array, "R L"], epochs: int, key: Array
) -> tuple[tuple[Array, Array], Lessons]:
    """What is taught, and how, where each run has pairs of its own.

    Args:
        pairs: inputs and targets, with a leading axis of runs.
        rows: how many of a run's are for training, the first; the others are its test.
        starts: of the runs.
        epochs: in each, a run takes its rows in a new order.
        key: of the orders.

    Returns:
        The pairs for training, those of all runs in line, and the lessons.
    """
    runs = len(starts)
    keys = jax.random.split(key, (runs, epochs))
    order = jax.vmap(jax.vmap(lambda k: jax.random.permutation(k, rows)))(keys)
    train = jax.tree.map(lambda a: a[:, :rows].reshape(-1, *a.shape[2:]), pairs)
    test = jax.tree.map(lambda a: a[:, rows:], pairs)
    return train, Lessons(starts, order + rows * jnp.arange(runs)[:, None, None], test)


def once(runs: int, epochs: int, rows: int) -> Int[Array, "R E N"]:
    """An order that takes runs × epochs × rows pairs once each: new ones for every run and epoch."""
    return jnp.arange(runs * epochs * rows).reshape(runs, epochs, rows)


def for_each(runs: int, test: Any) -> Any:
    """One test set for all runs."""
    return jax.tree.map(lambda a: jnp.broadcast_to(a, (runs, *a.shape)), test)


@eqx.filter_jit
def _curves(learner: Learner, lessons: Lessons, train: Any, score: Score) -> tuple[Array, Array, Array]:
    def run(given: Lessons) -> tuple[Array, Array, Array]:
        def epoch(state: Any, rows: Array) -> Any:
            def learned(state: Any, row: Array) -> Any:
                state, info = updated(learner.setup, state, *jax.tree.map(lambda a: a[row][None], train))
                return state, info.nis / info.prediction.shape[0]

            def step(state: Any, row: Array) -> Any:
                return jax.lax.cond(row < 0, lambda s, _: (s, jnp.zeros_like(s.mean[0])), learned, state, row)

            state, nis = jax.lax.scan(step, state, rows)
            return state, (score(learner, state, given.test), nis.mean(where=rows >= 0))

        first = learner.init()._replace(mean=given.start)
        state, (test_scores, nis) = jax.lax.scan(epoch, first, given.order)
        return test_scores, nis, state.mean

    return jax.lax.map(run, lessons)
