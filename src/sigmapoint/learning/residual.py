"""Any cost J = |e|²/2 as a residual that should be zero: 0 = e(w, x, d)."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.checks import data_checks
from sigmapoint.learning.objectives import Objective, listed
from sigmapoint.linear_algebra.factors import safe_sqrt
from sigmapoint.methods import Method
from sigmapoint.spaces import Euclidean, Space
from sigmapoint.variants import at_mean

MUST_BE_KNOWN = "A residual needs its targets: leave out the pairs that have none"


class Residual(eqx.Module):
    """0 = e(w, x, d)."""

    error: Callable[[Any, Any, Any], Any] = eqx.field(static=True)
    predict: Callable[[Any, Any], Any] | None = eqx.field(static=True)

    @property
    def memory_space(self) -> Space:
        return Euclidean()

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
    checks.function("error", error, "(w, x, d)")
    if predict is not None:
        checks.function("predict", predict, "(w, x)")
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
    checks.function("logits", logits, "(w, x)")

    def error(w: Any, x: Any, label: Any) -> Array:
        if label is None:
            raise ValueError("a target must be one whole number, the class, got None")
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
