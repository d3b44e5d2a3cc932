"""Checks of what the user hands over: one clear message that names the argument, what it was and what it should be.

Values are looked at only where they are known: under `jax.jit`, `grad` or `vmap` only shapes are checked.
"""

import importlib
import inspect
import operator
from collections.abc import Iterable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array


def array(name: str, value: Any) -> Array:
    """As a floating-point array."""
    unmasked(name, value)
    try:
        made = jnp.asarray(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be an array of numbers, got {_kind(value)}") from error
    if jnp.issubdtype(made.dtype, jnp.complexfloating):
        raise ValueError(f"{name} must be real, got {made.dtype}")
    if not jnp.issubdtype(made.dtype, jnp.floating):
        made = made.astype(float)
    return made


def _kind(value: Any) -> str:
    """What an array of something else holds, or why it is none."""
    try:
        made = np.asarray(value)
    except ValueError as error:
        return f"{type(value).__name__}: {error}"
    return f"an array of {made.dtype}" if made.ndim and made.dtype != object else type(value).__name__


def unmasked(name: str, value: Any) -> None:
    """No mask, which JAX drops: what is missing is NaN here."""
    if isinstance(value, np.ma.MaskedArray):
        raise ValueError(f"{name} must not be a masked array: pass {name}.astype(float).filled(np.nan)")


def whole(name: str, value: Any, least: int) -> int:
    """A whole number of at least `least`."""
    try:
        number = operator.index(value)
    except TypeError:
        number = None
    if number is None or number < least:
        raise ValueError(f"{name} must be a whole number of at least {least}, got {value!r}")
    return number


def number(name: str, value: Any) -> float:
    """One real number."""
    given = np.asarray(value)
    if given.ndim > 0 or given.dtype.kind not in "iuf":
        raise ValueError(f"{name} must be a number, got {value!r}")
    return float(given)


def fraction(name: str, value: Any) -> float:
    """A number above 0 and up to 1."""
    value = number(name, value)
    if not 0 < value <= 1:
        raise ValueError(f"{name} must be greater than 0 and at most 1, got {value}")
    return value


def instance(name: str, value: Any, kind: Any, maker: str = "") -> None:
    """An object of a class of this library; `maker` is how one is made, where users do not write the class."""
    if not isinstance(value, kind):
        expected, call = maker or f"a sp.{kind.__name__}", _call(value)
        hint = f"; call it: {name}={call}" if call else ""
        raise ValueError(f"{name} must be {expected}, got {type(value).__name__}{hint}")


def _call(value: Any) -> str:
    """How a function of this library is called, as `sp.proposals.guided(method)`; nothing where it is another."""
    import sigmapoint as sp

    name = getattr(value, "__name__", "")
    places = {"sp": sp, "sp.proposals": sp.proposals, "sp.moves": sp.moves}
    place = next((place for place, of in places.items() if getattr(of, name, None) is value), None) if name else None
    if place is None or not callable(value):
        return ""
    parameters = inspect.signature(value).parameters.values()
    names = [p.name for p in parameters if p.default is p.empty and p.kind is p.POSITIONAL_OR_KEYWORD]
    return f"{place}.{name}({', '.join(names)})"


def space(name: str, value: Any, size: int | None) -> None:
    """Something with `residual` and `retract`; of angles, each an element of a vector of that size."""
    if not (callable(getattr(value, "residual", None)) and callable(getattr(value, "retract", None))):
        raise ValueError(f"{name} must be sp.angles(...) or a sp.Manifold, got {value!r}")
    indices = getattr(value, "indices", ())
    if size is not None and any(not -size <= i < size for i in indices):
        raise ValueError(f"{name} names the elements {indices}, but there are {size}: 0 to {size - 1}")


def extra(module: str, what: str, group: str = "cli") -> Any:
    """A module of the packages that only some parts need; `group` is the extra that brings it."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise ImportError(f"{what} needs {error.name}: pip install sigmapoint[{group}]") from error


def function(name: str, value: Any, arguments: str) -> None:
    """Callable; of which arguments, the message says."""
    if not callable(value):
        raise ValueError(f"{name} must be a function of {arguments}, got {type(value).__name__}")


def known(value: Any) -> bool:
    """Whether the numbers are there to look at (not a tracer)."""
    return not isinstance(value, Tracer)


def untransformed(what: str, instead: str, *given: Any) -> None:
    """Not within a transformation of JAX: `what` looks at numbers on its way."""
    # A constant is a tracer while JAX traces, whatever was given.
    if not all(map(known, (jnp.zeros(()), *jax.tree.leaves(given)))):
        raise ValueError(
            f"{what} is not for use under jax.jit, jax.grad or jax.vmap: it looks at numbers on its way. Call it from "
            f"plain Python; what can be transformed is {instead}"
        )


def finite(name: str, value: Any, hint: str = "") -> None:
    """No NaN, no infinity."""
    if known(value):
        bad = ~np.isfinite(np.asarray(value))
        if bad.any():
            where = tuple(int(i) for i in np.argwhere(bad)[0])
            raise ValueError(
                f"{name} has {bad.sum()} NaN or infinite value(s), the first at index {where}. {hint}".strip()
            )


def key(name: str, given: Any) -> Array:
    """A random key, or a seed made into one."""
    if isinstance(given, int | np.integer) and not isinstance(given, bool):
        return jax.random.key(int(given))
    if isinstance(given, jax.Array) and given.shape == (2,) and given.dtype == jnp.uint32:
        return jax.random.wrap_key_data(given)
    if isinstance(given, jax.Array) and jnp.issubdtype(given.dtype, jax.dtypes.prng_key):
        return given
    raise ValueError(f"{name} must be jax.random.key(seed) or an integer seed, got {type(given).__name__}")


def callables(**functions: Any) -> None:
    """Each is a function."""
    for name, function in functions.items():
        if not callable(function):
            raise ValueError(f"{name} must be a function of (x, u), got {type(function).__name__}")


def names(name: str, given: Any, size: int | None = None, distinct: bool = True) -> tuple[str, ...] | None:
    """One string an element (where their number is known already), or nothing."""
    if given is None:
        return None
    many = f"{size} string(s), one an element" if size is not None else "strings, one an element"
    if isinstance(given, str) or not all(isinstance(s, str) for s in given) or size not in (None, len(given)):
        raise ValueError(f"{name} must be {many}, got {given!r}")
    if distinct and len(set(given)) != len(given):
        raise ValueError(f"{name} must differ from each other, got {given!r}")
    return tuple(given)


def selection(name: str, given: Any, allowed: tuple[str, ...]) -> tuple[str, ...]:
    """A selection of names, each one allowed."""
    if not isinstance(given, Iterable):
        raise ValueError(f"{name} must be names out of {', '.join(allowed)}, got {given!r}")
    given = (given,) if isinstance(given, str) else tuple(given)
    unknown = [g for g in given if g not in allowed]
    if unknown:
        raise ValueError(f"{name} has unknown name(s) {unknown}; choose from {', '.join(allowed)}")
    return given
