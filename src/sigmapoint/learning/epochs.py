"""Epochs of training, step by step: all that is needed to go on from anywhere."""

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint.learning import sharding
from sigmapoint.learning.checkpoints import fingerprint
from sigmapoint.learning.learner import Learner
from sigmapoint.learning.state import LearnerState
from sigmapoint.learning.trained import History, Progress
from sigmapoint.learning.update import updated

WORK = 2e8
"""Products in one call, about: between two calls there is time for progress, checkpoints and Ctrl-C."""
LONGEST_CALL = 1000


class Position(NamedTuple):
    """All that training goes on from."""

    state: LearnerState
    best: LearnerState | None
    """with the least error on the validation set, if there is one"""
    epoch: np.ndarray
    update: np.ndarray
    """number of updates of this epoch that are done"""
    sums: np.ndarray
    """over this epoch: squared innovations, NIS, log-likelihood, number of elements"""
    history: History


class Training(NamedTuple):
    """One run of it."""

    learner: Learner
    x: Any
    d: Array
    epochs: int
    batch: int
    key: Any
    held: tuple[Any, Array] | None
    patience: int | None

    def finite(self, at: Position) -> bool:
        """Whether the errors of the last epoch are, where there were targets at all."""
        last = int(at.epoch) - 1
        learned = np.isfinite(at.history.mse[last]) or not known(self.d)
        return bool(learned and (self.held is None or np.isfinite(at.history.validation[last])))

    @property
    def updates(self) -> int:
        """In an epoch."""
        return -(-len(self.d) // self.batch)

    @property
    def _call(self) -> int:
        L, M = self.learner.setup.parameters.start.shape[0], self.batch * (self.d.size // len(self.d))
        return max(1, min(LONGEST_CALL, self.updates, int(WORK / (L * L * (M + 4)))))

    def start(self) -> Position:
        """Before the first sample."""
        state = self.learner.init()
        nothing = History(*(np.full(self.epochs, np.nan) for _ in History._fields))
        best = None if self.held is None else _copied(state)
        return Position(state, best, np.array(0), np.array(0), np.zeros(4), nothing)

    def steps(self, at: Position) -> Iterator[Position]:
        """Positions on the way from there; the state of each is given away for the next."""
        L = self.learner.setup.parameters.start.shape[0]
        at = at._replace(state=sharding.spread(at.state, self.learner.setup.mesh, L))
        while not self.over(at):
            order = self._order(int(at.epoch))
            while int(at.update) < self.updates:
                part = order[int(at.update) : int(at.update) + self._call]
                x, d = jax.tree.map(lambda a, part=part: a[np.maximum(part, 0)], (self.x, self.d))
                filled = jnp.asarray(part >= 0).reshape(part.shape + (1,) * (d.ndim - 2))
                state = at.state if int(at.update) else at.state._replace(memory=self.learner.setup.initial_memory)
                state, sums = _many((self.learner, x, jnp.where(filled, d, jnp.nan)), state)
                at = at._replace(state=state, update=at.update + len(part), sums=at.sums + np.asarray(sums))
                if int(at.update) < self.updates:
                    yield at
            at = self._finished(at)
            yield at

    def _order(self, epoch: int) -> np.ndarray:
        """Which pairs every update takes, −1 for none."""
        N = len(self.d)
        pairs = np.arange(N) if self.key is None else np.asarray(jax.random.permutation(_of(self.key, epoch), N))
        return np.append(pairs, np.full(self.updates * self.batch - N, -1)).reshape(self.updates, self.batch)

    def _finished(self, at: Position) -> Position:
        squares, nis, likelihood, count = at.sums
        error = np.nan if self.held is None else float(_error(self.learner, at.state, *self.held))
        history = History(*(column.copy() for column in at.history))
        count = count or np.nan
        for column, value in zip(history, (squares / count, nis / count, likelihood, error)):
            column[int(at.epoch)] = value
        earlier = np.fmin.reduce(at.history.validation[: int(at.epoch)], initial=np.inf)
        best = _copied(at.state) if error < earlier else at.best
        return at._replace(best=best, epoch=at.epoch + 1, update=np.array(0), sums=np.zeros(4), history=history)

    def over(self, at: Position) -> bool:
        """Whether there is nothing left to do."""
        return int(at.epoch) >= self.epochs or self._stopped(at)

    def _stopped(self, at: Position) -> bool:
        if self.patience is None or not int(at.epoch):
            return False
        errors = at.history.validation[: int(at.epoch)]
        return not np.isfinite(errors).any() or int(at.epoch) - 1 - int(np.nanargmin(errors)) >= self.patience

    def done(self, at: Position) -> float:
        """Part of the whole, 0 to 1."""
        return (int(at.epoch) + int(at.update) / self.updates) / self.epochs

    def progress(self, at: Position, first: float, seconds: float) -> Progress:
        """For people, `seconds` after the beginning at `first`."""
        done, past = self.done(at), int(at.epoch)
        left = seconds * (1 - done) / max(done - first, 1e-12)
        ended = int(at.update) == 0
        mse = at.history.mse[past - 1] if ended else at.sums[0] / max(at.sums[3], 1)
        last = at.history.validation[past - 1] if past else np.nan
        return Progress(past if ended else past + 1, self.epochs, done, left, float(mse), float(last))

    @property
    def identity(self) -> np.ndarray:
        """A fingerprint of all that the result depends on."""
        key = None if self.key is None else jax.random.key_data(_of(self.key, 0)).tolist()
        program = jax.make_jaxpr(self.learner.setup.values)(
            self.learner.setup.parameters.start, jax.tree.map(lambda a: a[:1], self.x)
        )
        made_of = re.sub(" at 0x[0-9a-f]+", "", str(program))
        setup = self.learner.setup
        settings = setup.method, setup.drift, setup.noise, self.epochs, self.batch, key, made_of
        return fingerprint((*settings, self.patience), (self.learner.setup.parameters, self.x, self.d, self.held))


def _of(key: Any, epoch: int) -> Any:
    return jax.random.fold_in(key, epoch)


def known(d: Array) -> bool:
    """Whether there is a target at all."""
    return bool((~np.isnan(d)).any())


def _copied(state: LearnerState) -> LearnerState:
    return jax.tree.map(jnp.copy, state)


@eqx.filter_jit(donate="all-except-first")
def _many(given: tuple[Learner, Any, Array], state: LearnerState) -> tuple[LearnerState, Float[Array, " 4"]]:
    """One update after the other, in the memory of the state; the sums over them."""
    learner, x, d = given

    def step(state: LearnerState, pair: tuple[Any, Array]) -> tuple[LearnerState, Array]:
        state, info = updated(learner.setup, state, *pair)
        there = ~jnp.isnan(jnp.ravel(pair[1]))  # a prediction that is NaN shows
        squares = jnp.sum(jnp.where(there, info.innovation, 0.0) ** 2)
        return state, jnp.stack([squares, info.nis, info.log_likelihood, jnp.sum(there, dtype=squares.dtype)])

    state, sums = jax.lax.scan(step, state, (x, d))
    return state, sums.sum(axis=0)


@eqx.filter_jit
def _error(learner: Learner, state: LearnerState, x: Any, d: Array) -> Float[Array, ""]:
    there = ~jnp.isnan(d)
    return jnp.sum(jnp.where(there, learner.setup.values(state.mean, x) - d, 0.0) ** 2) / jnp.sum(there, dtype=d.dtype)
