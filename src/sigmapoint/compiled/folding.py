"""A user's function, rewritten: people write `A @ x` and `jnp.sin`, and both are part of the native loop.

Small matrix products become sums (`native.product`), circular functions what vectorises (`elementary`).
"""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jax.extend import core
from jaxtyping import Array

from sigmapoint.compiled.elementary import VECTORISED
from sigmapoint.compiled.native import product
from sigmapoint.compiled.runtime import NATIVE


def folded(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function in the forms that loops run fast with (outside of loops and branches of its own)."""
    if not NATIVE:
        return function

    def run(*args: Any) -> Any:
        closed, shape = jax.make_jaxpr(function, return_shape=True)(*args)
        if not _rewritable(closed.jaxpr):
            return function(*args)
        values = _evaluate(closed.jaxpr, closed.consts, jax.tree.leaves(args))
        return jax.tree.unflatten(jax.tree.structure(shape), values)

    return run


def _rewritable(jaxpr: Any) -> bool:
    return any(
        _rewritable(eqn.params["jaxpr"].jaxpr) if eqn.primitive.name == "jit" else _foldable(eqn) or _vectorisable(eqn)
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
        elif _foldable(eqn):
            results = [_summed(*operands, *eqn.params["dimension_numbers"][0])]
        elif _vectorisable(eqn):
            results = [VECTORISED[eqn.primitive](*operands)]
        else:
            results = eqn.primitive.bind(*operands, **eqn.primitive.get_bind_params(eqn.params))
            results = results if eqn.primitive.multiple_results else [results]
        values.update(zip(eqn.outvars, results))
    return [read(v) for v in jaxpr.outvars]


def _foldable(eqn: Any) -> bool:
    if eqn.primitive.name != "dot_general":
        return False
    contracted, batch = eqn.params["dimension_numbers"]
    a, b, result = (v.aval for v in (*eqn.invars, *eqn.outvars))
    simple = batch == ((), ()) and len(contracted[0]) == 1 and max(a.ndim, b.ndim) <= 2
    return simple and a.dtype == b.dtype == result.dtype


def _vectorisable(eqn: Any) -> bool:
    return eqn.primitive in VECTORISED and all(v.aval.dtype == np.float64 for v in eqn.invars)


def _summed(a: Array, b: Array, left: tuple[int, ...], right: tuple[int, ...]) -> Array:
    A = a[None] if a.ndim == 1 else (a if left == (1,) else a.T)
    B = b[:, None] if b.ndim == 1 else (b if right == (0,) else b.T)
    return product(A, B).reshape((*A.shape[: a.ndim - 1], *B.shape[1 : b.ndim]))
