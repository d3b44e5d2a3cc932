"""Training: many pairs, in epochs, with a validation set, progress, and checkpoints that survive anything."""

import os
import re
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.learning import checkpoints, sharding
from sigmapoint.learning.checkpoints import fingerprint
from sigmapoint.learning.drift import Drift
from sigmapoint.learning.fit import Fit, History, Progress
from sigmapoint.learning.interrupts import uninterrupted
from sigmapoint.learning.learner import Learner, learner, updated
from sigmapoint.learning.objectives import Objective
from sigmapoint.learning.state import LearnerState
from sigmapoint.methods import Method

WORK = 2e8
"""Products in one call, about: between two calls there is time for progress, checkpoints and Ctrl-C."""
LONGEST_CALL = 1000
NOT_FINITE = (
    "the function's values, or their spread, are not finite: sigma points may reach where it is not defined. A smaller "
    "prior_std, sp.srekf(), or parameters on another scale (logarithms) may help; classes are numbered from 0"
)
SAVED_EVERY = 30.0
"""Seconds between checkpoints within an epoch."""


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


def learn(
    function: Callable[[Any, Any], Any] | Objective,
    w0: Any,
    inputs: Any,
    targets: Any,
    *,
    noise: Any,
    method: Method | None = None,
    drift: Drift | None = None,
    prior_std: Any = 1.0,
    devices: Sequence[Any] | None = None,
    epochs: int = 1,
    batch: int = 1,
    key: Any = None,
    validation: tuple[Any, Any] | None = None,
    patience: int | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    progress: Callable[[Progress], Any] | None = None,
) -> Fit:
    """Train a function on pairs of inputs and targets.

    Every epoch counts all pairs again: with more than one, error bars say more than the data do, by √epochs. For error
    bars take one epoch, from the parameters that more epochs have found.

    Args:
        function: as for `learner`, like all up to `devices`. A recurrent one begins every epoch without memory.
        w0: where to start.
        inputs: any pytree of arrays with a leading axis N.
        targets: (N, ...); NaN where they are not known.
        noise: of a target.
        method: `srcdkf()` where not given.
        drift: `fixed(0)` where not given.
        prior_std: how far `w0` may be off.
        devices: those that the parameters are spread over.
        epochs: how often all pairs are learned from.
        batch: pairs that are learned from at once.
        key: a random key or a seed: the order is drawn anew for every epoch. In the order given where there is none.
        validation: inputs and targets that are not learned from; the state after the best epoch is kept.
        patience: stop after so many epochs without a better one on the validation set.
        checkpoint: a file. What is done is saved there every half minute and at the end, and taken up from there if the
            file exists: a run that was killed and started again ends with the same numbers.
        progress: called now and then with a `Progress`, for example `print`.

    Returns:
        A `Fit`: `params`, `state`, `history`, `predict`.

    Raises:
        ValueError: as `learner`; inputs and targets of different lengths, no targets, patience without validation, a
            checkpoint of another run, a recurrent function out of order (with a key) or in batches that do not fit.
        OSError: the checkpoint cannot be written.

    Examples:
        >>> import jax, jax.numpy as jnp, sigmapoint as sp
        >>> x = jnp.linspace(-1, 1, 50)
        >>> fit = sp.learn(lambda w, x: w["a"] * x + w["b"], {"a": 0.0, "b": 0.0}, x, 3 * x - 1, noise=0.01, epochs=2,
        ...                key=0)
        >>> round(float(fit.params["a"]), 2), fit.history.mse.shape
        (3.0, (2,))
    """
    if validation is not None and not (isinstance(validation, tuple | list) and len(validation) == 2):
        raise ValueError("validation must be a pair (inputs, targets)")
    one = learner(function, w0, noise=noise, method=method, drift=drift, prior_std=prior_std, devices=devices)
    x, d = one.checked(inputs, targets)
    d = one.targets(x, d)
    epochs, batch = checks.whole("epochs", epochs, 1), checks.whole("batch", batch, 1)
    key = None if key is None else checks.key("key", key)
    if one.forgotten.mean.size and (key is not None or len(d) % batch):
        raise ValueError("a recurrent function takes a series in order and in whole batches: no key, batch a divisor")
    held = None if validation is None else one.checked(*validation)
    if held is not None:
        held = held[0], one.targets(*held)
        if not _known(held[1]):
            raise ValueError("validation has no known target")
    if patience is not None:
        patience = checks.whole("patience", patience, 1)
        if held is None:
            raise ValueError("patience needs a validation set")
    if progress is not None and not callable(progress):
        raise ValueError(f"progress must be a function of a sp.Progress, got {type(progress).__name__}")
    run = Training(one, x, d, epochs, min(batch, len(d)), key, held, patience)
    at = run.start()
    if checkpoint is not None:
        at = checkpoints.resumed(Path(checkpoint), run.identity, at)
    saved = begun = time.monotonic()
    first, steps = run.done(at), run.steps(at)
    if checkpoint is not None:  # a file that cannot be written shows now
        checkpoints.store(Path(checkpoint), run.identity, at)
    try:
        while not run.over(at):
            with uninterrupted():
                at = next(steps)
            now, ended = time.monotonic(), int(at.update) == 0
            if checkpoint is not None and (now - saved >= SAVED_EVERY or run.over(at)):
                checkpoints.store(Path(checkpoint), run.identity, at)
                saved = now
            if ended and not run.finite(at):
                warnings.warn(NOT_FINITE, RuntimeWarning, stacklevel=2)
            if progress is not None:
                progress(run.progress(at, first, now - begun))
    except KeyboardInterrupt:
        if checkpoint is not None and not at.state.mean.is_deleted():  # given away, if pressed twice
            checkpoints.store(Path(checkpoint), run.identity, at)
        raise
    return Fit(one, at.best or at.state, History(*(column[: int(at.epoch)] for column in at.history)))


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
        learned = np.isfinite(at.history.mse[last]) or not _known(self.d)
        return bool(learned and (self.held is None or np.isfinite(at.history.validation[last])))

    @property
    def updates(self) -> int:
        """In an epoch."""
        return -(-len(self.d) // self.batch)

    @property
    def _call(self) -> int:
        L, M = self.learner.parameters.start.shape[0], self.batch * (self.d.size // len(self.d))
        return max(1, min(LONGEST_CALL, self.updates, int(WORK / (L * L * (M + 4)))))

    def start(self) -> Position:
        """Before the first sample."""
        state = self.learner.init()
        nothing = History(*(np.full(self.epochs, np.nan) for _ in History._fields))
        best = None if self.held is None else _copied(state)
        return Position(state, best, np.array(0), np.array(0), np.zeros(4), nothing)

    def steps(self, at: Position) -> Iterator[Position]:
        """Positions on the way from there; the state of each is given away for the next."""
        L = self.learner.parameters.start.shape[0]
        at = at._replace(state=sharding.spread(at.state, self.learner.mesh, L))
        while not self.over(at):
            order = self._order(int(at.epoch))
            while int(at.update) < self.updates:
                part = order[int(at.update) : int(at.update) + self._call]
                x, d = jax.tree.map(lambda a, part=part: a[np.maximum(part, 0)], (self.x, self.d))
                filled = jnp.asarray(part >= 0).reshape(part.shape + (1,) * (d.ndim - 2))
                state = at.state if int(at.update) else at.state._replace(memory=self.learner.forgotten)
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
        program = jax.make_jaxpr(self.learner.values)(
            self.learner.parameters.start, jax.tree.map(lambda a: a[:1], self.x)
        )
        made_of = re.sub(" at 0x[0-9a-f]+", "", str(program))
        settings = self.learner.method, self.learner.drift, self.learner.noise, self.epochs, self.batch, key, made_of
        return fingerprint((*settings, self.patience), (self.learner.parameters, self.x, self.d, self.held))


def _of(key: Any, epoch: int) -> Any:
    return jax.random.fold_in(key, epoch)


def _known(d: Array) -> bool:
    """Whether there is a target at all."""
    return bool((~np.isnan(d)).any())


def _copied(state: LearnerState) -> LearnerState:
    return jax.tree.map(jnp.copy, state)


@eqx.filter_jit(donate="all-except-first")
def _many(given: tuple[Learner, Any, Array], state: LearnerState) -> tuple[LearnerState, Float[Array, " 4"]]:
    """One update after the other, in the memory of the state; the sums over them."""
    learner, x, d = given

    def step(state: LearnerState, pair: tuple[Any, Array]) -> tuple[LearnerState, Array]:
        state, info = updated(learner, state, *pair)
        there = ~jnp.isnan(jnp.ravel(pair[1]))  # a prediction that is NaN shows
        squares = jnp.sum(jnp.where(there, info.innovation, 0.0) ** 2)
        return state, jnp.stack([squares, info.nis, info.log_likelihood, jnp.sum(there, dtype=squares.dtype)])

    state, sums = jax.lax.scan(step, state, (x, d))
    return state, sums.sum(axis=0)


@eqx.filter_jit
def _error(learner: Learner, state: LearnerState, x: Any, d: Array) -> Float[Array, ""]:
    there = ~jnp.isnan(d)
    return jnp.sum(jnp.where(there, learner.values(state.mean, x) - d, 0.0) ** 2) / jnp.sum(there, dtype=d.dtype)
