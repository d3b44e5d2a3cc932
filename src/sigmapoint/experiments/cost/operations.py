"""Floating-point operations of a JAX function: XLA's own count of each operation, times the turns of its loops.

XLA's cost analysis takes the body of a loop once, and calls of LAPACK for nothing. Here a loop counts as often as it
runs, and a factorisation by its textbook number. Of several branches the cheapest counts: the others are for what is
singular.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
from jax.extend import core

BY_LIBRARY: dict[str, Callable[..., float]] = {
    "cholesky": lambda A: A[-1] ** 3 / 3,
    "geqrf": lambda A: 2 * A[-1] ** 2 * (A[-2] - A[-1] / 3),
    "householder_product": lambda A, _: 2 * A[-1] ** 2 * (A[-2] - A[-1] / 3),
    "triangular_solve": lambda A, b: A[-1] * b[-1] * b[-2],
}
"""From the shapes of their arguments (Golub & Van Loan, "Matrix Computations")."""


def operations(function: Callable[..., Any], *args: Any) -> float:
    """How many operations a call takes.

    Raises:
        NotImplementedError: a loop whose number of turns depends on its data.
    """
    return _counted(jax.make_jaxpr(function)(*args).jaxpr)


def _counted(jaxpr: Any) -> float:
    structured = [(eqn, _structured(eqn)) for eqn in jaxpr.eqns]
    rest = [eqn for eqn, known in structured if known is None]
    return sum(known for _, known in structured if known is not None) + _by_xla(rest)


def _structured(eqn: Any) -> float | None:
    """Of what is made of other functions, or is a library's."""
    name, params = eqn.primitive.name, eqn.params
    if name == "scan":
        return params["length"] * _counted(params["jaxpr"].jaxpr)
    if name == "cond":
        return min(_counted(branch.jaxpr) for branch in params["branches"])
    if name == "while":
        raise NotImplementedError("the turns of a loop that ends by its data cannot be counted")
    if name in BY_LIBRARY:
        return float(BY_LIBRARY[name](*(x.aval.shape for x in eqn.invars)))
    inner = next((p for p in params.values() if isinstance(p, core.ClosedJaxpr | core.Jaxpr)), None)
    if inner is None:
        return None
    return _counted(inner.jaxpr if isinstance(inner, core.ClosedJaxpr) else inner)


def _by_xla(eqns: Sequence[Any]) -> float:
    """Of all these, each on its own."""

    def apart(groups: Any) -> Any:
        return [eqn.primitive.bind(*group, **eqn.params) for eqn, group in zip(eqns, groups)]

    given = [[jax.ShapeDtypeStruct(x.aval.shape, x.aval.dtype) for x in eqn.invars] for eqn in eqns]
    return float((jax.jit(apart).lower(given).cost_analysis() or {}).get("flops", 0.0))
