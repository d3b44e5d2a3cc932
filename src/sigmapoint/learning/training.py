"""Training: many pairs, in epochs, with a validation set, progress, and checkpoints that survive anything."""

import os
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from sigmapoint import checks
from sigmapoint.learning import checkpoints
from sigmapoint.learning.drift import Drift
from sigmapoint.learning.epochs import Training, known
from sigmapoint.learning.interrupts import uninterrupted
from sigmapoint.learning.learner import learner
from sigmapoint.learning.objectives import Objective
from sigmapoint.learning.trained import History, Progress, Trained
from sigmapoint.methods import Method

NOT_FINITE = (
    "the function's values, or their spread, are not finite: sigma points may reach where it is not defined. A smaller "
    "prior_std, sp.srekf(), or parameters on another scale (logarithms) may help; classes are numbered from 0"
)
SAVED_EVERY = 30.0
"""Seconds between checkpoints within an epoch."""


def learn(
    function: Callable[[Any, Any], Any] | Objective,
    w0: Any,
    inputs: Any,
    targets: Any,
    *,
    noise: Any,
    method: Method | None = None,
    drift: Drift | float | None = None,
    prior_std: Any = 1.0,
    devices: Sequence[Any] | None = None,
    epochs: int = 1,
    batch: int = 1,
    key: Any = None,
    validation: tuple[Any, Any] | None = None,
    patience: int | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    progress: Callable[[Progress], Any] | None = None,
) -> Trained:
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
        A `Trained`: `params`, `state`, `history`, `predict`.

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
    x, d = one.setup.checked(inputs, targets)
    d = one.setup.targets(x, d)
    epochs, batch = checks.whole("epochs", epochs, 1), checks.whole("batch", batch, 1)
    key = None if key is None else checks.key("key", key)
    if one.setup.initial_memory.mean.size and (key is not None or len(d) % batch):
        raise ValueError("a recurrent function takes a series in order and in whole batches: no key, batch a divisor")
    held = None if validation is None else one.setup.checked(*validation)
    if held is not None:
        held = held[0], one.setup.targets(*held)
        if not known(held[1]):
            raise ValueError("validation has no known target")
    if patience is not None:
        patience = checks.whole("patience", patience, 1)
        if held is None:
            raise ValueError("patience needs a validation set")
    if progress is not None:
        checks.function("progress", progress, "a sp.Progress")
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
    return Trained(one, at.best or at.state, History(*(column[: int(at.epoch)] for column in at.history)))
