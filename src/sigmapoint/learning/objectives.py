"""What is learned from pairs (x, d): a function of x that predicts d, one with a memory, or a residual.

All are seen in one way, `values(w, memory, inputs) -> (values, memory after)` beside the targets of these values:

* a function: d = G(w, x), no memory (an empty vector);
* recurrent: h⁺, d = G(w, h, x), where h is what it remembers of the inputs before;
* a residual: 0 = e(w, x, d), any cost J = |e|²/2 ("observed error": Wan & van der Merwe 2001, section 7.4.3).
"""

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from sigmapoint import checks, data_checks
from sigmapoint.linalg import safe_sqrt
from sigmapoint.methods import Method
from sigmapoint.variants import at_mean

MUST_BE_KNOWN = "A residual needs its targets: leave out the pairs that have none"


@runtime_checkable
class Objective(Protocol):
    """What is learned."""

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

    def checked(self, x: Any, d: Any, dtype: Any) -> tuple[Any, Array | np.ndarray | None]:
        return _paired(x, d, dtype)

    def remembered(self, dtype: Any) -> Float[Array, " H"]:
        return jnp.zeros(0, dtype)

    def values(self, w: Any, memory: Float[Array, " H"], inputs: Any) -> tuple[Float[Array, "B ..."], Array]:
        return jax.vmap(lambda x: jnp.asarray(self.function(w, x)))(inputs), memory

    def prediction(self, w: Any, memory: Float[Array, " H"], x: Any) -> Array:
        return jnp.asarray(self.function(w, x))

    def predicted_by(self, method: Method) -> Method:
        return method


class Recurrent(eqx.Module):
    """h⁺, d = G(w, h, x)."""

    cell: Callable[[Any, Any, Any], tuple[Any, Any]] = eqx.field(static=True)
    start: Any

    def checked(self, x: Any, d: Any, dtype: Any) -> tuple[Any, Array | np.ndarray | None]:
        return _paired(x, d, dtype)

    def remembered(self, dtype: Any) -> Float[Array, " H"]:
        return ravel_pytree(self.start)[0].astype(dtype)

    def values(self, w: Any, memory: Float[Array, " H"], inputs: Any) -> tuple[Float[Array, "B ..."], Array]:
        unravel = ravel_pytree(self.start)[1]

        def once(h: Array, x: Any) -> tuple[Array, Array]:
            after, value = self.cell(w, unravel(h), x)
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


class Residual(eqx.Module):
    """0 = e(w, x, d)."""

    error: Callable[[Any, Any, Any], Any] = eqx.field(static=True)
    predict: Callable[[Any, Any], Any] | None = eqx.field(static=True)

    def checked(self, x: Any, d: Any, dtype: Any) -> tuple[Any, Array | np.ndarray | None]:
        d = jax.tree.map(lambda a: np.asarray(a) if listed(a) else a, d, is_leaf=listed)
        shape = next((np.shape(leaf) for leaf in jax.tree.leaves((d, x))), ())
        if not shape or not shape[0]:
            raise ValueError(f"inputs and targets must be (B, ...) with B >= 1, got shape {shape}")
        x = data_checks.inputs(x, shape[0], dtype, "inputs", "targets")
        return (x, data_checks.inputs(d, shape[0], dtype, "targets", "inputs", MUST_BE_KNOWN)), None

    def remembered(self, dtype: Any) -> Float[Array, " H"]:
        return jnp.zeros(0, dtype)

    def values(self, w: Any, memory: Float[Array, " H"], inputs: Any) -> tuple[Float[Array, "B ..."], Array]:
        return jax.vmap(lambda x, d: jnp.asarray(self.error(w, x, d)))(*inputs), memory

    def prediction(self, w: Any, memory: Float[Array, " H"], x: Any) -> Array:
        if self.predict is None:
            raise ValueError("a residual alone predicts nothing: give sp.residual(e, predict=...) a function of (w, x)")
        return jnp.asarray(self.predict(w, x))

    def predicted_by(self, method: Method) -> Method:
        # By the value at the mean: a sum with a negative weight may leave the range of values, of probabilities say.
        return at_mean(method)


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
    _callable("cell", cell, "(w, h, x)")
    h0 = jax.tree.map(partial(checks.array, "h0"), h0)
    flat = ravel_pytree(h0)[0]
    if not flat.size:
        raise ValueError("h0 must hold at least one number; without a memory, pass the function itself")
    checks.finite("h0", flat)
    return Recurrent(cell, h0)


def residual(error: Callable[[Any, Any, Any], Any], predict: Callable[[Any, Any], Any] | None = None) -> Objective:
    """Any cost, as a residual that should be zero, for `learner` and `learn` in place of a function.

    Σ |e|² / (2 noise) is what is minimised. A cost J ≥ 0 of an error has the residual ±√(2J), with the sign of the
    error: a residual that is folded up at zero has no slope there. A sample that counts c times as much as another has
    √c times its residual.

    Args:
        error: `error(w, x, d)` for input `x` and target `d`, any pytrees (class labels, for example); any shape. Both
            must be known: leave out a pair that is not.
        predict: `predict(w, x)`, which `Learner.predict` is to give for new inputs: the value at the mean of the
            parameters.

    Raises:
        ValueError: no function.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> circle = sp.residual(lambda w, x, d: jnp.hypot(*(x - w["centre"])) - w["radius"])
        >>> learner = sp.learner(circle, {"centre": jnp.zeros(2), "radius": 1.0}, noise=1e-4)
        >>> s = learner.init()
        >>> for angle in jnp.arange(0.0, 20.0):
        ...     s, _ = learner.update(s, jnp.stack([3 + 2 * jnp.cos(angle), 1 + 2 * jnp.sin(angle)]), None)
        >>> round(float(learner.params(s)["radius"]), 2)
        2.0
    """
    _callable("error", error, "(w, x, d)")
    if predict is not None:
        _callable("predict", predict, "(w, x)")
    return Residual(error, predict)


def cross_entropy(logits: Callable[[Any, Any], Any]) -> Objective:
    """Classification: e = √(−2 log p) with p the probability of the class that it was. Its noise is 1.

    Args:
        logits: `logits(w, x)`, one number for each class, shape (K,): logarithms of the odds, up to a constant. Targets
            are whole numbers from 0 to K − 1, each known; any other number makes everything NaN. `Learner.predict`
            gives the probabilities of the classes, at the mean of the parameters.

    Raises:
        ValueError: no function.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> learner = sp.learner(sp.cross_entropy(lambda w, x: jnp.stack([0.0 * x, w * x])), 0.0, noise=1.0)
        >>> s = learner.init()
        >>> for x in (-1.0, 1.0, 2.0, -2.0):
        ...     s, _ = learner.update(s, x, int(x > 0))
        >>> bool(learner.predict(s, 1.0).mean[1] > 0.7)
        True
    """
    _callable("logits", logits, "(w, x)")

    def error(w: Any, x: Any, label: Any) -> Array:
        z, label = jnp.asarray(logits(w, x)), jnp.asarray(label)
        if z.ndim != 1:
            hint = "; for two classes return jnp.stack([0, z])" if z.ndim == 0 else ""
            raise ValueError(f"logits must have shape (K,), one number a class, got {z.shape}{hint}")
        if label.ndim:
            raise ValueError(f"a target must be one whole number, the class, got shape {label.shape}; one-hot? argmax")
        label = label.astype(int) if label.dtype == bool else label
        own = jnp.arange(z.shape[0], dtype=label.dtype) == label
        odds = jax.nn.logsumexp(jnp.where(own, -jnp.inf, z - jnp.sum(jnp.where(own, z, 0.0))))
        return jnp.where(own.any(), safe_sqrt(2 * jax.nn.softplus(odds)), jnp.nan)

    return Residual(error, lambda w, x: jax.nn.softmax(jnp.asarray(logits(w, x))))


def listed(d: Any) -> bool:
    """Whether this is a target written as a list."""
    return isinstance(d, list)


def objective(given: Any) -> Objective:
    """What was given as a function."""
    if isinstance(given, Objective):
        return given
    if not callable(given):
        raise ValueError(f"function must be a function of (w, x), got {type(given).__name__}")
    return Function(given)


def _callable(name: str, given: Any, arguments: str) -> None:
    if not callable(given):
        raise ValueError(f"{name} must be a function of {arguments}, got {type(given).__name__}")


def _shapes(tree: Any) -> Any:
    return jax.tree.map(jnp.shape, tree)


def _paired(x: Any, d: Any, dtype: Any) -> tuple[Any, Array | np.ndarray]:
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
