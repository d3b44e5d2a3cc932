"""Simulators that JAX cannot trace, as functions of a model.

The whole set of sigma points is handed over in one call (and a batch of series in one, too), either to a function that
takes many rows at once, or row by row, or row by row over worker processes. An exception inside the simulator reaches
the user as it was raised, with its own traceback: JAX passes on no more than its text, so a ticket goes into the text,
and the exception is kept until the ticket comes back.
"""

import itertools
import multiprocessing
import pickle
import re
import signal
import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from sigmapoint import checks

_kept: dict[int, BaseException] = {}
_lock = threading.Lock()
_numbers = itertools.count(1)
MOST_KEPT = 64
"""Exceptions whose tickets may never come back (raised beside another, or under the user's own `jax.jit`)."""


class Ticket(RuntimeError):
    """Stands for an exception on its way through JAX."""

    def __init__(self, error: BaseException):
        with _lock:
            number = next(_numbers)
            _kept[number] = error
            while len(_kept) > MOST_KEPT:
                del _kept[min(_kept)]
        super().__init__(f"{type(error).__name__} in a blackbox: {error} [blackbox ticket {number}]")


class NoDerivative(ValueError):
    """A simulator was asked for its derivative."""


class Blackbox:
    """A function of NumPy arrays that a model can call; made by `blackbox`."""

    def __init__(self, function: Callable[..., Any], size: int | None, vectorized: bool, workers: int):
        self._function = function
        self._size = size
        self._vectorized = vectorized
        self._workers = workers
        self._pool: ProcessPoolExecutor | None = None

    def __call__(self, x: Array, *rest: Any) -> Array:
        x = jnp.asarray(x)
        size = x.shape[-1] if self._size is None else self._size
        shape = jax.ShapeDtypeStruct((size,), x.dtype)
        # A derivative would need the simulator's inside; stop it here with a message of our own.
        return _opaque(self, shape, x, *rest)

    def close(self) -> None:
        """End the worker processes, if there are any."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
            self._pool = None

    def _call(self, size: int, dtype: Any, *args: Any) -> np.ndarray:
        """Evaluate rows: every leaf of `args` has the same leading axes, over which the function is called."""
        try:
            args = jax.tree.map(np.asarray, args)
            if args[0].dtype != dtype:
                raise ValueError(
                    f"blackbox: a state of {dtype} arrived as {args[0].dtype}. JAX calls black boxes from threads of "
                    "its own, which `with jax.enable_x64(...)` does not reach: use "
                    'jax.config.update("jax_enable_x64", True)'
                )
            batch = args[0].shape[:-1]
            rows = jax.tree.map(lambda a: a.reshape((-1, *a.shape[len(batch) :])), args)
            values = self._rows(rows, int(np.prod(batch, dtype=int)))
            values = _real(values).astype(dtype)
            if values.shape != (int(np.prod(batch, dtype=int)), size):
                expected = f"(rows, {size})" if self._vectorized else f"({size},)"
                got = values.shape if self._vectorized else values.shape[1:]
                raise ValueError(f"blackbox: the function must return shape {expected}, got {got}; see `size`")
            return values.reshape((*batch, size))
        except BaseException as error:
            raise Ticket(error) from error

    def _rows(self, rows: Any, count: int) -> Any:
        if self._vectorized:
            return self._function(*rows)
        if self._workers == 0:
            return _each(self._function, rows, count)
        if self._pool is None:
            _sendable(self._function)
            # `spawn`: a forked child would inherit the locks of JAX's threads.
            self._pool = ProcessPoolExecutor(
                self._workers, multiprocessing.get_context("spawn"), signal.signal, (signal.SIGINT, signal.SIG_IGN)
            )  # Ctrl-C is for this process, which ends them
        # A part for each process in arrays of many rows: to send arrays costs by their number, not by their size.
        ends = [count * i // self._workers for i in range(self._workers + 1)]
        try:
            parts = [
                self._pool.submit(_each, self._function, jax.tree.map(lambda a, i=i, j=j: a[i:j], rows), j - i)
                for i, j in itertools.pairwise(ends)
                if j > i
            ]
            return np.concatenate([part.result() for part in parts]) if parts else []
        except BrokenProcessPool as error:
            self.close()
            error.add_note("blackbox: a worker process ended; did the simulator crash, or run out of memory?")
            raise


def _real(values: Any) -> np.ndarray:
    """As an array; None and text are no numbers, though NumPy would make NaN or digits of them."""
    made = np.asarray(values)
    if made.dtype.kind not in "biuf":
        raise ValueError(f"blackbox: the function must return real numbers, got {made.dtype}: {made.flat[0]!r}")
    return made


def _sendable(function: Callable[..., Any]) -> None:
    try:
        pickle.dumps(function)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        error.add_note(
            "blackbox: with workers the function is sent to other processes: define it with `def` at the top of a "
            "module, not as a lambda or inside a function"
        )
        raise


def _each(function: Callable[..., Any], rows: tuple[Any, ...], count: int) -> np.ndarray:
    leaves, structure = jax.tree.flatten(rows)
    return _real([function(*jax.tree.unflatten(structure, [leaf[i] for leaf in leaves])) for i in range(count)])


def _opaque(box: Blackbox, shape: jax.ShapeDtypeStruct, *args: Any) -> Array:
    @jax.custom_jvp
    def call(*args: Any) -> Array:
        def host(*args: Any) -> np.ndarray:
            return box._call(shape.shape[0], shape.dtype, *args)

        return jax.pure_callback(host, shape, *args, vmap_method="broadcast_all")

    @call.defjvp
    def no_derivative(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> Any:
        raise NoDerivative(
            "a blackbox has no derivative: use a sigma-point method (sp.srcdkf(), sp.ukf(), ...), or give the model "
            "dynamics_jacobian / observation_jacobian"
        )

    return call(*args)


def blackbox(
    function: Callable[..., Any], *, size: int | None = None, vectorized: bool = False, workers: int = 0
) -> Blackbox:
    """Use a Python, C or any other simulator as `dynamics` or `observation`.

    Args:
        function: takes NumPy arrays `(x, u)` (and a noise where it is not additive) and returns the next state or the
            measurement. It must not keep anything between calls.
        size: length of what it returns; that of `x` where not given.
        vectorized: the function takes all points at once, `x` (p, n) and every leaf of `u` with p rows, and returns
            (p, size).
        workers: number of processes to spread the points over; 0 calls the function in this one. With workers the
            function must be importable (not a lambda), and a script needs its `if __name__ == "__main__":`.

    Returns:
        A callable for `StateSpaceModel`. `.close()` ends its workers.

    Raises:
        ValueError: not a function; a size below one; workers below zero, or together with `vectorized`.

    An exception inside the function comes out of `filter`, `smooth`, `simulate` and `online` as it was raised. Under
    `jax.jit` of your own (and other transformations around these calls) it arrives from JAX as a `JaxRuntimeError`,
    with its type and message in the text.

    Examples:
        >>> import jax.numpy as jnp, numpy as np, sigmapoint as sp
        >>> step = sp.blackbox(lambda x, u: np.array([0.9 * x[0]]))
        >>> model = sp.StateSpaceModel(step, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> sp.filter(model, jnp.ones((4, 1)), method=sp.ukf()).mean.shape
        (4, 1)
    """
    if not callable(function):
        raise ValueError(f"blackbox: function must be callable, got {type(function).__name__}")
    size = None if size is None else checks.whole("blackbox: size", size, 1)
    workers = checks.whole("blackbox: workers", workers, 0)
    if workers and vectorized:
        raise ValueError(
            "blackbox: a vectorized function gets all points in one call; give workers or vectorized, not both"
        )
    return Blackbox(function, size, vectorized, workers)


def unwrapped(compute: Callable[..., Any], *args: Any) -> Any:
    """`compute(*args)`, where an exception from inside a simulator comes out as itself.

    The result is waited for: an exception that arises after the call has returned could only come out as JAX's.
    """
    try:
        result = compute(*args)
        for leaf in jax.tree.leaves(result):
            if isinstance(leaf, jax.Array) and checks.known(leaf):
                leaf.block_until_ready()  # one program: where one of its results is ready, all are
                break
        return result
    except (jax.errors.JaxRuntimeError, Ticket) as failure:
        tickets = re.findall(r"\[blackbox ticket (\d+)\]", str(failure))
        with _lock:
            errors = [_kept.pop(int(number), None) for number in dict.fromkeys(tickets)]
        error = next((error for error in errors if error is not None), None)
        if error is None:
            raise
        raise error from None
