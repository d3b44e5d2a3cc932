"""Learning curves: one function trained from many starts, in epochs, with its error on a test set after each."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sigmapoint.learning.learner import Learner, updated


class Curves(NamedTuple):
    """One row a run, one column an epoch."""

    test: Float[np.ndarray, "R E"]
    """mean squared error of an element on the test set after the epoch"""
    nis: Float[np.ndarray, "R E"]
    """mean NIS of an element over the epoch"""


def curves(
    learner: Learner,
    starts: Float[Array, "R L"],
    train: tuple[Array, Array],
    orders: Int[Array, "R E N"],
    test: tuple[Array, Array],
) -> Curves:
    """Train from every start, each in its own order of the training pairs."""
    return Curves(*map(np.asarray, _curves(learner, starts, train, orders, test)))


def orders(runs: int, epochs: int, rows: int, key: Array) -> Int[Array, "R E N"]:
    """An order of the training pairs for every run and epoch."""
    keys = jax.random.split(key, (runs, epochs))
    return jax.vmap(jax.vmap(lambda k: jax.random.permutation(k, rows)))(keys)


@eqx.filter_jit
def _curves(learner: Learner, starts: Array, train: Any, orders: Array, test: Any) -> tuple[Array, Array]:
    def run(given: tuple[Array, Array]) -> tuple[Array, Array]:
        mean, order = given

        def epoch(state: Any, rows: Array) -> Any:
            def step(state: Any, row: Array) -> Any:
                state, info = updated(learner, state, *(a[row][None] for a in train))
                return state, info.nis / info.prediction.shape[0]

            state, nis = jax.lax.scan(step, state, rows)
            error = jnp.mean((learner.values(state.mean, test[0]) - test[1]) ** 2)
            return state, (error, nis.mean())

        return jax.lax.scan(epoch, learner.init()._replace(mean=mean), order)[1]

    return jax.lax.map(run, (starts, orders))
