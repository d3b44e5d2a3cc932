"""Parameters as one vector: any pytree there and back."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from sigmapoint import checks


class Parameters(eqx.Module):
    """Those to start with."""

    start: Float[Array, " L"]
    std: Float[Array, " L"]
    rest: Any
    """leaves that are not parameters"""
    unravel: Callable[[Array], Any] = eqx.field(static=True)

    @classmethod
    def of(cls, w0: Any, std: Any) -> "Parameters":
        """From a pytree and its standard deviations: a number, or a pytree like it."""
        dtypes = {a.dtype for a in jax.tree.leaves(w0) if _inexact(a)}
        dtype = next(iter(dtypes)) if len(dtypes) == 1 else float
        w0 = jax.tree.map(lambda a: jnp.asarray(a, dtype) if _number(a) else a, w0)
        arrays, rest = eqx.partition(w0, _inexact)
        start, unravel = _vector(arrays)
        if jax.tree.structure(std) == jax.tree.structure(w0):
            std = jax.tree.map(lambda a, s: s if _inexact(a) else None, w0, std)
        return cls(start, _deviations(std, arrays, start), rest, unravel)

    def tree(self, w: Float[Array, " L"]) -> Any:
        """The pytree with these parameters."""
        return eqx.combine(self.unravel(w), self.rest)


def _inexact(a: Any) -> bool:
    return eqx.is_inexact_array(a) or (isinstance(a, np.ndarray) and np.issubdtype(a.dtype, np.inexact))


def _number(a: Any) -> bool:
    return isinstance(a, int | float) and not isinstance(a, bool)


def _vector(arrays: Any) -> tuple[Float[Array, " L"], Callable[[Array], Any]]:
    leaves = jax.tree.leaves(arrays)
    dtypes = {jnp.asarray(a).dtype for a in leaves}
    if not sum(np.size(a) for a in leaves):
        raise ValueError("w0 has no parameters: it must hold at least one array of floating-point numbers")
    if len(dtypes) > 1 or not jnp.issubdtype(next(iter(dtypes)), jnp.floating):
        raise ValueError(f"w0 must be of one floating-point type, got {', '.join(sorted(map(str, dtypes)))}")
    start, unravel = ravel_pytree(arrays)
    checks.finite("w0", start)
    return start, unravel


def _deviations(given: Any, arrays: Any, start: Array) -> Float[Array, " L"]:
    alone = jax.tree.structure(given) == jax.tree.structure(0)
    if not alone and jax.tree.structure(given) != jax.tree.structure(arrays):
        raise ValueError("prior_std must be a number, or a pytree with the structure of w0")
    each = jax.tree.map(lambda a: given, arrays) if alone else given
    try:
        full = jax.tree.map(lambda s, a: jnp.broadcast_to(jnp.asarray(s, start.dtype), jnp.shape(a)), each, arrays)
    except ValueError as error:
        raise ValueError(f"prior_std does not fit w0: {error}") from None
    std = ravel_pytree(full)[0]
    if checks.known(std) and not (np.isfinite(std) & (np.asarray(std) >= 0)).all():
        raise ValueError("prior_std must be finite and not negative")
    return std
