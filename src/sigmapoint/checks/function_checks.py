"""Checks of the user's functions as they are called: what they are handed, what they return, what their errors mean."""

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array


def called(name: str, function: Any, *args: Any) -> Any:
    """`function(*args)`; an error of the usual kinds says what to write, or what of the input was not given."""
    try:
        return function(*args)
    except (jax.errors.TracerArrayConversionError, jax.errors.ConcretizationTypeError) as error:
        error.add_note(
            f"{name} is traced by JAX: write jnp.sin for np.sin or math.sin and jnp.where for if, or wrap a function "
            "that cannot be traced, sp.blackbox(function)"
        )
        raise
    except (TypeError, AttributeError, ValueError, IndexError) as error:
        if args[1] is None and "None" in str(error):
            error.add_note(f"{name} was called with u=None: pass u=... (to update and predict of sp.online, too)")
        else:
            error.add_note(f"{name} was called with {', '.join(map(_shapes, ('x', 'u', 'w'), args))}")
        raise
    except KeyError as error:
        note_keys(error, name, "u", args[1])
        raise


def note_keys(error: KeyError, name: str, argument: str, given: Any) -> None:
    """Say which keys there are, where it was one of these that was not there."""
    if isinstance(given, Mapping) and error.args[:1] and error.args[0] not in given:
        error.add_note(f"{name} was called with a {argument} that has the keys {', '.join(map(repr, given))}")


def _shapes(name: str, value: Any) -> str:
    """An argument as its shapes: `x (2,)`, `u {'dt': ()}`."""
    return f"{name} {jax.tree.map(jnp.shape, value)}"


def columns(measured: int, value: Any) -> None:
    """A row of y has as many elements as the vector that the observation function returns."""
    shape = getattr(value, "shape", None)
    if shape is not None and len(shape) == 1 and shape[0] != measured:
        raise ValueError(
            f"y has {measured} element(s) a row, but observation returns {shape[0]}: y must be (T, {shape[0]}), "
            f"one row a sample (is it transposed?), and a single sample ({shape[0]},)"
        )


def returned(name: str, value: Any, shape: tuple[int, ...], meaning: str) -> Array:
    """What a user's function returned, as one array of the expected shape."""
    try:
        made = jnp.asarray(value)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"{name} must return one array of shape {shape}, got {type(value).__name__}; "
            "put scalars together with jnp.stack([...])"
        ) from error
    if made.shape != shape:
        raise ValueError(f"{name} must return an array of shape {shape} ({meaning}), got shape {made.shape}")
    return made
