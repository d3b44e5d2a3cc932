"""A loop over a long series, in chunks whose buffers stay small: see `runtime`."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from sigmapoint.runtime import NATIVE, SMALL

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
    one = jax.tree.map(lambda a: jax.ShapeDtypeStruct(a.shape[1:], a.dtype), rows)
    each = max(_bytes(one) + _bytes(jax.eval_shape(step, start, one)[1]), 1)
    chunks = -(-T * each * 2 // SMALL) if NATIVE else 1
    if NATIVE and real is not None:
        chunks = max(chunks, -(-T // SKIPPED))
    whole = chunks <= 1 or chunks >= T
    if whole and real is None:
        return jax.lax.scan(step, start, rows, reverse=reverse)

    def guarded(state: Any, row: Any) -> tuple[Any, Any]:
        real, row = row
        after, out = step(state, row)
        return (after if complete else jax.tree.map(lambda a, b: jnp.where(real, a, b), after, state)), out

    every, complete = real is None, False
    real = jnp.ones(T, bool) if real is None else real
    if whole:
        return jax.lax.scan(guarded, start, (real, rows), reverse=reverse)
    # Chunks that fill up leave nothing to cut off afterwards.
    chunks = next((c for c in range(chunks, 2 * chunks + 1) if T % c == 0), chunks)
    size = -(-T // chunks)
    chunks = -(-T // size)
    spare = chunks * size - T
    complete = every and not spare

    sides = (spare, 0) if reverse else (0, spare)

    def folded(a: Array) -> Array:
        # Rows that fill the last chunk repeat the one beside them.
        a = jnp.pad(a, [sides, *[(0, 0)] * (a.ndim - 1)], mode="edge") if spare else a
        return a.reshape(chunks, size, *a.shape[1:])

    def through(state: Any, chunk: Any) -> tuple[Any, Any]:
        return jax.lax.scan(guarded, state, chunk, reverse=reverse)

    def past(state: Any, chunk: Any) -> tuple[Any, Any]:
        out = jax.eval_shape(through, state, chunk)[1]
        return state, jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), out)

    def one_chunk(state: Any, chunk: Any) -> tuple[Any, Any]:
        return through(state, chunk) if every else jax.lax.cond(chunk[0].any(), through, past, state, chunk)

    real = jnp.pad(real, sides).reshape(chunks, size)
    end, out = jax.lax.scan(one_chunk, start, (real, jax.tree.map(folded, rows)), reverse=reverse)
    kept = slice(spare, None) if reverse else slice(T)
    return end, jax.tree.map(lambda a: a.reshape(chunks * size, *a.shape[2:])[kept], out)


def _bytes(tree: Any) -> int:
    return sum(a.size * a.dtype.itemsize for a in jax.tree.leaves(tree))
