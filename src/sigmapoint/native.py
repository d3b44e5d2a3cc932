"""Small array programs in a form that XLA compiles into one native function.

On a CPU, XLA turns a loop over time into one function, without a dispatch for each operation, where its body has small
buffers only and calls no library (`runtime`). Then three things decide over its speed, and they are arranged here:

* A matrix product is a library call. `product` writes a small one as a sum of outer products, which vectorises;
  `folded` does the same inside a user's function.
* XLA computes anew what it fuses into several places: a chain of n steps can cost 2ⁿ. `materialized` keeps a value.
* Library factorisations are calls too; `linalg` has its own for small sizes.

Larger arrays are faster in the libraries, and so is everything where loops are not native.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend import core
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, Float

from sigmapoint.runtime import NATIVE

LARGEST = 24
"""The largest dimension of a small array."""


def small(n: int) -> bool:
    """Whether arrays of dimension `n` are handled here rather than in a library."""
    return NATIVE and n <= LARGEST


def product(A: Float[Array, "n k"], B: Float[Array, "k m"]) -> Float[Array, "n m"]:
    """`A @ B`."""
    n, k = A.shape
    if not small(max(n, B.shape[1])) or not 0 < k <= 4 * LARGEST:
        return A @ B
    A, B = materialized(A), materialized(B)
    total = A[:, :1] * B[:1]
    for i in range(1, k):
        total = total + A[:, i : i + 1] * B[i : i + 1]
    return total


def applied(A: Float[Array, "n k"], x: Float[Array, " k"]) -> Float[Array, " n"]:
    """`A @ x`."""
    return product(A, x[:, None])[:, 0]


def materialized(x: Array) -> Array:
    """`x`, computed once: it is not fused into what uses it."""
    return _materialized_p.bind(x) if NATIVE and not isinstance(x, np.ndarray) and x.size > 1 else x


def _kept(x: Array) -> Array:
    # A branch that no finite number takes; the compiler does not know that, and has to keep the value.
    never = jnp.ravel(x)[0] > jnp.inf
    return jax.lax.cond(never, lambda x: x + x, lambda x: x, x)


_materialized_p = core.Primitive("materialized")
_materialized_p.def_impl(lambda x: x)
_materialized_p.def_abstract_eval(lambda x: x)
ad.deflinear2(_materialized_p, lambda cotangent, _: [_materialized_p.bind(ad.instantiate_zeros(cotangent))])
batching.defvectorized(_materialized_p)
mlir.register_lowering(_materialized_p, lambda ctx, x: [x])
mlir.register_lowering(_materialized_p, mlir.lower_fun(_kept, multiple_results=False), platform="cpu")


def folded(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function with its small matrix products as sums."""

    if not NATIVE:
        return function

    def run(*args: Any) -> Any:
        closed, shape = jax.make_jaxpr(function, return_shape=True)(*args)
        if not _has_products(closed.jaxpr):
            return function(*args)
        values = _evaluate(closed.jaxpr, closed.consts, jax.tree.leaves(args))
        return jax.tree.unflatten(jax.tree.structure(shape), values)

    return run


def _has_products(jaxpr: Any) -> bool:
    return any(
        eqn.primitive.name == "dot_general" or any(map(_has_products, core.jaxprs_in_params(eqn.params)))
        for eqn in jaxpr.eqns
    )


def _evaluate(jaxpr: Any, consts: Any, args: Any) -> list[Any]:
    values: dict[Any, Any] = dict(zip([*jaxpr.constvars, *jaxpr.invars], [*consts, *args]))

    def read(v: Any) -> Any:
        return v.val if isinstance(v, core.Literal) else values[v]

    for eqn in jaxpr.eqns:
        operands = [read(v) for v in eqn.invars]
        if eqn.primitive.name == "jit":
            inner = eqn.params["jaxpr"]
            results = _evaluate(inner.jaxpr, inner.consts, operands)
        elif eqn.primitive.name == "dot_general" and _foldable(eqn):
            results = [_summed(*operands, *eqn.params["dimension_numbers"][0])]
        else:
            results = eqn.primitive.bind(*operands, **eqn.primitive.get_bind_params(eqn.params))
            results = results if eqn.primitive.multiple_results else [results]
        values.update(zip(eqn.outvars, results))
    return [read(v) for v in jaxpr.outvars]


def _foldable(eqn: Any) -> bool:
    contracted, batch = eqn.params["dimension_numbers"]
    a, b = (v.aval for v in eqn.invars)
    return batch == ((), ()) and len(contracted[0]) == 1 and a.ndim <= 2 and b.ndim <= 2 and a.dtype == b.dtype


def _summed(a: Array, b: Array, left: tuple[int, ...], right: tuple[int, ...]) -> Array:
    A = a[None] if a.ndim == 1 else (a if left == (1,) else a.T)
    B = b[:, None] if b.ndim == 1 else (b if right == (0,) else b.T)
    return product(A, B).reshape((*A.shape[: a.ndim - 1], *B.shape[1 : b.ndim]))
