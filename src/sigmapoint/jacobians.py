"""Jacobians that a user gives in place of automatic derivatives.

A Jacobian replaces the derivative of a function with respect to the state alone. Its derivatives with respect to inputs
and to whatever it closes over (parameters being fitted) stay its own, to any order; the Jacobian itself moves with the
state and the parameters like any function.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from sigmapoint import checks
from sigmapoint.checks import function_checks
from sigmapoint.linear_algebra.leading import leading


def with_jacobian(name: str, function: Callable[..., Any], jacobian: Callable[..., Any] | None) -> Callable[..., Any]:
    """`function(x, ...)` whose derivative in `x` is `jacobian(x, u)`, where given; its other derivatives are kept."""
    if jacobian is None:
        return function
    checks.callables(**{name: jacobian})

    def differentiated(x: Array, *rest: Any) -> Array:
        def slope(x: Array, *rest: Any) -> Array:
            shape = (value.shape[0], x.shape[0])
            made = function_checks.returned(
                name, jacobian(x, *rest[:1]), shape, "one row for each element of the value"
            )
            return made.astype(value.dtype)

        # What either function closes over (parameters being fitted) becomes arguments, to be differentiated too.
        plain, held = jax.closure_convert(function, x, *rest)
        value = jax.eval_shape(plain, x, *rest, *held)
        sloped, held_by_slope = jax.closure_convert(slope, x, *rest)
        return _sloped(plain, sloped, x, rest, held, held_by_slope)

    return differentiated


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def _sloped(
    function: Callable[..., Array], slope: Callable[..., Array], x: Array, rest: Any, held: Any, held_by_slope: Any
) -> Array:
    """`function(x, *rest, *held)`, whose derivative in `x` is `slope` and whose others are its own."""
    return leading(function(x, *rest, *held), x, rest, held, held_by_slope)


@partial(_sloped.defjvp, symbolic_zeros=True)
def _sloped_jvp(
    function: Callable[..., Array], slope: Callable[..., Array], primals: tuple[Any, ...], tangents: tuple[Any, ...]
) -> tuple[Array, Array]:
    x, rest, _, held_by_slope = primals
    value = _sloped(function, slope, *primals)
    moved = jnp.zeros_like(value)
    if not all(_still(leaf) for leaf in jax.tree.leaves(tangents[1:3], is_leaf=_still)):
        others = tuple(jax.tree.map(_instantiated, primals[1:3], tangents[1:3]))
        moved = jax.jvp(lambda rest, held: function(x, *rest, *held), primals[1:3], others)[1]
    if not _still(tangents[0]):
        moved = moved + slope(x, *rest, *held_by_slope) @ tangents[0]
    return leading((value, moved), primals)


def _still(tangent: Any) -> bool:
    """Whether nothing moves here: a function that has no derivative of its own is not asked for one."""
    return isinstance(tangent, jax.custom_derivatives.SymbolicZero)


def _instantiated(primal: Array, tangent: Any) -> Any:
    return jax.custom_derivatives.zero_from_primal(primal) if _still(tangent) else tangent
