"""Functions with a memory: h⁺, d = G(w, h, x)."""

from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.learning.objectives import Objective, paired
from sigmapoint.methods import Method
from sigmapoint.spaces import Euclidean, Space


class Recurrent(eqx.Module):
    """h⁺, d = G(w, h, x)."""

    cell: Callable[[Any, Any, Any], tuple[Any, Any]] = eqx.field(static=True)
    start: Any

    @property
    def memory_space(self) -> Space:
        return Euclidean()

    def checked(self, x: Any, d: Any, dtype: Any) -> tuple[Any, Array | np.ndarray | None]:
        return paired(x, d, dtype)

    def remembered(self, dtype: Any) -> Float[Array, " H"]:
        return ravel_pytree(self.start)[0].astype(dtype)

    def values(self, w: Any, memory: Float[Array, " H"], inputs: Any) -> tuple[Float[Array, "B ..."], Array]:
        unravel = ravel_pytree(self.start)[1]

        def once(h: Array, x: Any) -> tuple[Array, Array]:
            given = self.cell(w, unravel(h), x)
            if not isinstance(given, tuple) or len(given) != 2:
                raise ValueError(f"cell must return (memory like h0, prediction), got {type(given).__name__}")
            after, value = given
            flat = ravel_pytree(after)[0].astype(h.dtype)
            if jax.tree.structure(after) != jax.tree.structure(self.start) or flat.shape != h.shape:
                raise ValueError(f"cell must return (memory like h0, prediction); the memory is {_shapes(after)}")
            return flat, jnp.asarray(value)

        memory, values = jax.lax.scan(once, memory, inputs)
        return values, memory

    def prediction(self, w: Any, memory: Float[Array, " H"], x: Any) -> Array:
        return self.values(w, memory, jax.tree.map(lambda a: jnp.asarray(a)[None], x))[0][0]

    def predicted_by(self, method: Method) -> Method:
        return method


def recurrent(cell: Callable[[Any, Any, Any], tuple[Any, Any]], h0: Any) -> Objective:
    """A function with a memory, for `learner` and `learn` in place of a function.

    What it remembers depends on the parameters. That is followed by its derivative ∂h/∂w, found in the same way as that
    of the prediction (by derivatives or by sigma points: real-time recurrent learning, Williams & Zipser 1989), and so
    the memory moves as the parameters do; to first order, also for sigma points. O(H L²) for a memory of H numbers.

    Args:
        cell: `cell(w, h, x) -> (h_after, prediction)` for input `x`; the memory `h` is a pytree like `h0`.
        h0: the memory before the first sample: any pytree of floating-point numbers.

    Raises:
        ValueError: no function, `h0` that is empty or not finite.

    Examples:
        >>> import sigmapoint as sp
        >>> def smooth(w, h, x):  # a first-order lag with an unknown rate
        ...     h = h + w * (x - h)
        ...     return h, h
        >>> lag = sp.learner(sp.recurrent(smooth, 0.0), 0.1, noise=1e-4)
        >>> s, y = lag.init(), 0.0
        >>> for k in range(50):
        ...     y = y + 0.3 * (k % 7 - y)
        ...     s, info = lag.update(s, float(k % 7), y)
        >>> round(float(lag.params(s)), 3)
        0.3
    """
    checks.function("cell", cell, "(w, h, x)")
    h0 = jax.tree.map(partial(checks.array, "h0"), h0)
    flat = ravel_pytree(h0)[0]
    if not flat.size:
        raise ValueError("h0 must hold at least one number; without a memory, pass the function itself")
    checks.finite("h0", flat)
    return Recurrent(cell, h0)


def _shapes(tree: Any) -> Any:
    return jax.tree.map(jnp.shape, tree)
