"""A loop over a long series, in chunks whose buffers stay small: see `runtime`."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from sigmapoint.compiled.runtime import NATIVE, SMALL

SKIPPED = 64
"""Rows that are left out together where none of them is there."""


def scan(
    step: Callable[[Any, Any], tuple[Any, Any]],
    start: Any,
    rows: Any,
    *,
    real: Array | None = None,
    reverse: bool = False,
) -> tuple[Any, Any]:
    """`jax.lax.scan`, in as many chunks as the size of its rows asks for.

    Args:
        step: `(state, row) -> (state, out)`.
        start: the state before the first row (after the last one with `reverse`).
        rows: pytree of arrays with a leading axis of the same length.
        real: which of the rows there are; the others only fill up and leave the state as it is. All, where not given.
        reverse: from the last row to the first.

    Returns:
        The state at the end, and what `step` gave out, stacked.
    """
    T = jax.tree.leaves(rows)[0].shape[0]
    # Backward, a step is computed again from the state before: to store what it computed takes longer than that.
    step = jax.checkpoint(step, prevent_cse=False)
    chunks, size = _chunks(T, step, start, rows, real)
    spare = chunks * size - T
    ends = real is not None
    if spare:  # the rows that fill the last chunk repeat the one beside them, and are not real
        sides = (spare, 0) if reverse else (0, spare)
        real = jnp.pad(jnp.ones(T, bool) if real is None else real, sides)
        rows = jax.tree.map(lambda a: jnp.pad(a, [sides, *[(0, 0)] * (a.ndim - 1)], mode="edge"), rows)
    if real is not None:
        step, rows = _guarded(step), (real, rows)
    if chunks == 1:
        return jax.lax.scan(step, start, rows, reverse=reverse)

    def through(state: Any, chunk: Any) -> tuple[Any, Any]:
        return jax.lax.scan(step, state, chunk, reverse=reverse)

    def past(state: Any, chunk: Any) -> tuple[Any, Any]:
        out = jax.eval_shape(through, state, chunk)[1]
        return state, jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), out)

    def one_chunk(state: Any, chunk: Any) -> tuple[Any, Any]:
        return jax.lax.cond(chunk[0].any(), through, past, state, chunk) if ends else through(state, chunk)

    rows = jax.tree.map(lambda a: a.reshape(chunks, size, *a.shape[1:]), rows)
    end, out = jax.lax.scan(one_chunk, start, rows, reverse=reverse)
    kept = slice(spare, None) if reverse else slice(T)
    return end, jax.tree.map(lambda a: a.reshape(chunks * size, *a.shape[2:])[kept], out)


def _chunks(T: int, step: Any, start: Any, rows: Any, real: Array | None) -> tuple[int, int]:
    """Number and size of the chunks: as few as are small; a number that divides the rows if one is near: no copy."""
    if not NATIVE:
        return 1, T
    one = jax.tree.map(lambda a: jax.ShapeDtypeStruct(a.shape[1:], a.dtype), rows)
    each = max(_bytes(one) + sum(map(_bytes, jax.eval_shape(step, start, one))), 1)
    least = max(-(-T * each * 8 // SMALL), 1 if real is None else -(-T // SKIPPED))
    if not 1 < least < T:
        return 1, T
    size = -(-T // next((chunks for chunks in range(least, 2 * least + 1) if T % chunks == 0), least))
    return -(-T // size), size


def _guarded(step: Callable[[Any, Any], tuple[Any, Any]]) -> Callable[[Any, Any], tuple[Any, Any]]:
    def guarded(state: Any, row: Any) -> tuple[Any, Any]:
        real, row = row
        after, out = step(state, row)
        return jax.tree.map(lambda a, b: jnp.where(real, a, b), after, state), out

    return guarded


def _bytes(tree: Any) -> int:
    return sum(a.size * a.dtype.itemsize for a in jax.tree.leaves(tree))


def one_by_one() -> bool:
    """Whether many small programs of the same kind are best run one after the other, each a loop of its own."""
    return NATIVE and jax.default_backend() == "cpu"


def of_each(one: Callable[..., Any], *rows: Any) -> Any:
    """`one(*row)` for every row, one by one where loops are native, and in step elsewhere."""
    if one_by_one():
        return jax.lax.scan(lambda _, row: (None, one(*row)), None, rows)[1]
    return jax.vmap(one)(*rows)
