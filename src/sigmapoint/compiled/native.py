"""Small array programs in a form that XLA compiles into one native function.

On a CPU, XLA turns a loop over time into one function, without a dispatch for each operation, where its body has small
buffers only and calls no library (`runtime`). Then three things decide over its speed, and they are arranged here:

* A matrix product is a library call. `product` writes a small one as a sum of outer products, which vectorises;
  `folding` does the same inside a user's function.
* XLA computes anew what it fuses into several places: a chain of n steps can cost 2ⁿ. `materialized` keeps a value.
* Library factorisations are calls too; `linear_algebra` has their own for small sizes.

Larger arrays are faster in the libraries, and so is everything where loops are not native.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental.xla_metadata import set_xla_metadata
from jax.extend import core
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, Float, Int

from sigmapoint.compiled.runtime import NATIVE, SMALL

LARGEST = 16
"""The largest dimension of a small array."""


def small(n: int) -> bool:
    """Whether arrays of dimension `n` are handled here rather than in a library."""
    return NATIVE and n <= LARGEST


def product(A: Float[Array, "n k"], B: Float[Array, "k m"]) -> Float[Array, "n m"]:
    """`A @ B`."""
    n, k = A.shape
    if not small(max(n, B.shape[1])) or not 0 < k <= 4 * LARGEST:
        return A @ B
    A, B = materialized(A), materialized(B)  # apart: in a derivative one is linear in the tangent, the other is not
    total = A[:, :1] * B[:1]
    for i in range(1, k):
        total = total + A[:, i : i + 1] * B[i : i + 1]
    return total


def gram(A: Float[Array, "k n"]) -> Float[Array, "n n"]:
    """`Aᵀ A`."""
    k, n = A.shape
    if not small(n) or not 0 < k <= 4 * LARGEST:
        return A.T @ A
    A = materialized(A)
    total = A[0][:, None] * A[0][None, :]
    for row in A[1:]:
        total = total + row[:, None] * row[None, :]
    return materialized(total)


def applied(A: Float[Array, "n k"], x: Float[Array, " k"]) -> Float[Array, " n"]:
    """`A @ x`."""
    return product(A, x[:, None])[:, 0]


def running_sum(x: Float[Array, " N"]) -> Float[Array, " N"]:
    """`jnp.cumsum(x)`; XLA's own is made for a parallel machine."""
    return _running(jnp.add, x) if _one_loop(x) else jnp.cumsum(x)


def running_max(x: Int[Array, " N"]) -> Int[Array, " N"]:
    """`jax.lax.cummax(x)`."""
    return _running(jnp.maximum, x) if _one_loop(x) else jax.lax.cummax(x)


def _one_loop(x: Array) -> bool:
    return NATIVE and x.size * x.dtype.itemsize <= SMALL // 4


def _running(combine: Callable[[Array, Array], Array], x: Array) -> Array:
    def step(total: Array, value: Array) -> tuple[Array, Array]:
        total = combine(total, value)
        return total, total

    return jax.lax.scan(step, jnp.zeros((), x.dtype), x)[1]


def looped(step: Callable[..., tuple[Any, Any]], state: Any, once: Array | None, *given: Any) -> tuple[Any, Any]:
    """`step(state, *given)`, as a loop that runs `once` times: only loops become native.

    `once` is the number one, which the compiler must not know, or nothing for no loop. `step` gives the state after, of
    the same kind, and something more.
    """
    if once is None or not NATIVE:
        return step(state, *given)
    besides = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), jax.eval_shape(step, state, *given)[1])

    def body(i: Array, carry: Any) -> Any:
        # What does not change in a loop is moved out of it, where every operation is a call: so it seems to change.
        inside = jax.tree.map(lambda a: jnp.where(i >= 0, a, jnp.zeros_like(a)), given)
        return step(carry[0], *inside)

    return jax.lax.fori_loop(0, once, body, (state, besides))


def materialized(*arrays: Array) -> Any:
    """The arrays, computed once where they are small: they are not fused into what uses them.

    Several together cost less than one by one.
    """
    computed = any(x.size > 1 and not isinstance(x, np.ndarray) for x in arrays)
    if NATIVE and computed and max(x.size for x in arrays) <= 4 * LARGEST**2:
        arrays = tuple(_materialized_p.bind(*arrays))
    return arrays[0] if len(arrays) == 1 else arrays


def _kept(*arrays: Any) -> Any:
    # Into a call, which it may not write out in its place, the compiler fuses nothing.
    with set_xla_metadata(inlineable="false"):
        return jax.jit(lambda *xs: xs)(*arrays)


def _batched(arrays: Any, axes: Any) -> tuple[Any, Any]:
    return _materialized_p.bind(*arrays), axes


def _jvp(primals: Any, tangents: Any) -> tuple[Any, Any]:
    return _materialized_p.bind(*primals), _materialized_p.bind(*map(ad.instantiate_zeros, tangents))


def _transposed(cotangents: Any, *arrays: Any) -> Any:
    back = _materialized_p.bind(*map(ad.instantiate_zeros, cotangents))
    return [ct if ad.is_undefined_primal(x) else None for ct, x in zip(back, arrays)]


_materialized_p = core.Primitive("materialized")
_materialized_p.multiple_results = True
_materialized_p.def_impl(lambda *xs: list(xs))
_materialized_p.def_abstract_eval(lambda *xs: list(xs))
ad.primitive_jvps[_materialized_p] = _jvp
ad.primitive_transposes[_materialized_p] = _transposed
batching.primitive_batchers[_materialized_p] = _batched
mlir.register_lowering(_materialized_p, lambda ctx, *xs: xs)
mlir.register_lowering(_materialized_p, mlir.lower_fun(_kept, multiple_results=True), platform="cpu")
