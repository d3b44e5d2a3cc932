"""Checks of what the user hands over: one clear message that names the argument, what it was and what it should be.

Values are looked at only where they are known: under `jax.jit`, `grad` or `vmap` only shapes are checked.
"""

import importlib
import operator
import warnings
from collections.abc import Iterable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from sigmapoint.spaces import Euclidean, folded

CANCELLED = 1e-3
"""Round-off of a mean, relative to the values that it is of, that is not passed over in silence."""


def array(name: str, value: Any) -> Array:
    """As a floating-point array."""
    unmasked(name, value)
    try:
        made = jnp.asarray(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be an array of numbers, got {type(value).__name__}: {error}") from error
    if jnp.issubdtype(made.dtype, jnp.complexfloating):
        raise ValueError(f"{name} must be real, got {made.dtype}")
    if not jnp.issubdtype(made.dtype, jnp.floating):
        made = made.astype(float)
    return made


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
        hint = f"; call it: {name}=sp.{value.__name__}()" if callable(value) and hasattr(value, "__name__") else ""
        expected = maker or f"a sp.{kind.__name__}"
        raise ValueError(f"{name} must be {expected}, got {type(value).__name__}{hint}")


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


def covariance(name: str, value: Array, series: bool = False) -> None:
    """(n, n), or (T, n, n) where `series`; symmetric; positive semi-definite."""
    shapes = "(n, n) or (T, n, n)" if series else "(n, n)"
    if value.ndim not in ((2, 3) if series else (2,)) or value.shape[-1] != value.shape[-2] or value.shape[-1] == 0:
        hint = ""
        if value.ndim < 2:
            hint = "; for one variance an element write jnp.diag(jnp.array([...])), for a single one jnp.array([[0.1]])"
        raise ValueError(f"{name} must be a covariance of shape {shapes}, got shape {value.shape}{hint}")
    if not known(value):
        return
    finite(name, value)
    P = np.asarray(value, np.float64)
    tol = 100 * float(jnp.finfo(value.dtype).eps)
    scale = np.sqrt(np.abs(np.einsum("...ii->...i", P)))
    bound = scale[..., :, None] * scale[..., None, :]
    skew = np.abs(P - np.swapaxes(P, -1, -2))
    if (skew > tol * np.maximum(bound, np.abs(P).max() * 1e-3)).any():
        *_, i, j = np.unravel_index(np.argmax(skew), P.shape)
        raise ValueError(
            f"{name} must be symmetric; element [{i}, {j}] and its mirror differ by {skew.max():.3g}. "
            "If the difference is round-off, pass (P + P.T) / 2"
        )
    diagonal = np.einsum("...ii->...i", P)
    if (diagonal < 0).any():
        i = np.argwhere(diagonal < 0)[0][-1]
        raise ValueError(
            f"{name} has a negative variance, {diagonal.min():.6g}, at element [{i}, {i}]; it must be >= 0"
        )
    correlation = P / np.where(bound > 0, bound, 1.0)
    lowest = np.linalg.eigvalsh((correlation + np.swapaxes(correlation, -1, -2)) / 2).min()
    if lowest < -tol * P.shape[-1] or (np.abs(P)[bound == 0] > 0).any():
        raise ValueError(
            f"{name} must be positive semi-definite; as a correlation matrix its smallest eigenvalue is {lowest:.3g}"
        )


def singular(cov: Any) -> bool:
    """Whether any covariance of a series leaves a combination of elements without a variance of its own."""
    P = np.asarray(cov, np.float64)
    scale = np.sqrt(np.einsum("...ii->...i", P))
    bound = scale[..., :, None] * scale[..., None, :]
    if not (bound > 0).all():
        return True
    return bool(np.linalg.eigvalsh(P / bound).min() <= P.shape[-1] * float(jnp.finfo(cov.dtype).eps))


def gaussian(name: str, noise: Any) -> None:
    """A noise that has a covariance, as a Gaussian filter needs."""
    if noise.distribution is not None and known(noise.cov) and not np.isfinite(np.asarray(noise.cov)).all():
        kind = type(noise).__name__
        raise ValueError(
            f"{name}: this distribution has no finite variance, which a Gaussian filter needs: give it a covariance "
            f"beside the distribution, sp.{kind}(cov, distribution=...), or use a particle filter, sp.bootstrap(1000)"
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


def initial(belief: Any, space: Any) -> None:
    """Mean, covariance and state space fit together."""
    mean, cov = belief.mean, belief.cov
    if mean.ndim != 1:
        raise ValueError(f"initial.mean must be (n,), got shape {mean.shape}")
    tangent = jax.eval_shape(space.residual, mean, mean).shape[0]
    if cov.shape != (tangent, tangent):
        raise ValueError(
            f"initial.cov must be ({tangent}, {tangent}) for a mean of shape {mean.shape}, got {cov.shape}"
        )


def digits(centre: float, dtype: Any) -> None:
    """A mean is values of the weights' size that cancel: digits are lost to a large weight of the centre."""
    lost = centre * float(jnp.finfo(dtype).eps)
    if lost > CANCELLED:
        warnings.warn(
            f"the sigma points of this method are so close together that means are good to about {lost:.1g} of a "
            f"value only in {dtype}: spread them (alpha=1), or compute in 64 bits: "
            'jax.config.update("jax_enable_x64", True)',
            stacklevel=5,
        )


def room(belief: Any, reach: float, space: Any, names: tuple[str, ...]) -> None:
    """Points `reach` standard deviations out stay where they are put; an angle past half a turn does not."""
    if isinstance(space, Euclidean) or not (known(belief.mean) and known(belief.cov)):
        return
    std = jnp.sqrt(jnp.diagonal(belief.cov)).astype(belief.mean.dtype)
    comes_back = folded(space, jnp.broadcast_to(belief.mean, (len(std), *belief.mean.shape)), std, reach)
    if comes_back.any():
        i = int(np.argmax(comes_back))
        name = names[i] if len(names) == len(std) else f"element {i}"
        raise ValueError(
            f"initial: the standard deviation of {name}, {float(std[i]):.3g}, is too wide for its space: a sigma point "
            f"{reach:.3g} of them away comes back elsewhere, as an angle does past half a turn. Use a smaller one, or "
            "sp.ekf(), or hold the angle as its cosine and sine"
        )


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
