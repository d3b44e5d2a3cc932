"""What is learned from pairs (x, d): a function of x that predicts d, one with a memory, or a residual.

All are seen in one way, `values(w, memory, inputs) -> (values, memory after)` beside the targets of these values:

* a function: d = G(w, x), no memory (an empty vector);
* recurrent: h⁺, d = G(w, h, x), where h is what it remembers of the inputs before;
* a residual: 0 = e(w, x, d), any cost J = |e|²/2 ("observed error": Wan & van der Merwe 2001, section 7.4.3).
"""

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.checks import data_checks
from sigmapoint.methods import Method
from sigmapoint.spaces import Euclidean, Space


@runtime_checkable
class Objective(Protocol):
    """What is learned."""

    @property
    def memory_space(self) -> Space:
        """In which memories differ."""
        ...

    def checked(self, x: Any, d: Any, dtype: Any) -> tuple[Any, Array | np.ndarray | None]:
        """Inputs and targets of `values`, with a leading axis B; nothing for targets that are zero."""
        ...

    def remembered(self, dtype: Any) -> Float[Array, " H"]:
        """The memory before the first sample."""
        ...

    def values(self, w: Any, memory: Float[Array, " H"], inputs: Any) -> tuple[Float[Array, "B ..."], Array]:
        """What should equal the targets, one input after the other, and the memory after them."""
        ...

    def prediction(self, w: Any, memory: Float[Array, " H"], x: Any) -> Array:
        """For one new input."""
        ...

    def predicted_by(self, method: Method) -> Method:
        """How that is averaged over what is known of the parameters."""
        ...


class Function(eqx.Module):
    """d = G(w, x)."""

    function: Callable[[Any, Any], Any] = eqx.field(static=True)

    @property
    def memory_space(self) -> Space:
        return Euclidean()

    def checked(self, x: Any, d: Any, dtype: Any) -> tuple[Any, Array | np.ndarray | None]:
        return paired(x, d, dtype)

    def remembered(self, dtype: Any) -> Float[Array, " H"]:
        return jnp.zeros(0, dtype)

    def values(self, w: Any, memory: Float[Array, " H"], inputs: Any) -> tuple[Float[Array, "B ..."], Array]:
        return jax.vmap(lambda x: jnp.asarray(self.function(w, x)))(inputs), memory

    def prediction(self, w: Any, memory: Float[Array, " H"], x: Any) -> Array:
        return jnp.asarray(self.function(w, x))

    def predicted_by(self, method: Method) -> Method:
        return method


def objective(given: Any) -> Objective:
    """What was given as a function."""
    if isinstance(given, Objective):
        return given
    checks.function("function", given, "(w, x)")
    return Function(given)


def listed(d: Any) -> bool:
    """Whether this is a target written as a list."""
    return isinstance(d, list)


def paired(x: Any, d: Any, dtype: Any) -> tuple[Any, Array | np.ndarray]:
    """Inputs and targets with a leading axis, as arrays."""
    if not jax.tree.leaves(x):
        raise ValueError("inputs must hold at least one array; where there are none, pass zeros (B,)")
    checks.unmasked("targets", d)
    d = d if isinstance(d, np.ndarray) and d.dtype == dtype else checks.array("targets", d)
    if d.ndim == 0 or d.shape[0] == 0:
        raise ValueError(f"targets must be (B, ...) with B >= 1, got shape {d.shape}")
    if checks.known(d) and bool(np.isinf(d).any()):
        raise ValueError("targets have infinite values; what is not known is NaN")
    return data_checks.inputs(x, d.shape[0], dtype, "inputs", "targets"), d.astype(dtype)
