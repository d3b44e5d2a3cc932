"""Resampling: as many particles as there were, all of one weight, each a copy of one of them (its ancestor).

A scheme maps `(key, log_weights)` to the ancestors, in ascending order; particle i has N Wᵢ copies on average, whatever
the scheme. They differ in how far the number strays from that:

* `multinomial`: N independent draws (Gordon, Salmond & Smith 1993).
* `residual`: ⌊N Wᵢ⌋ copies for certain, the rest by independent draws (Liu & Chen 1998; Wan & van der Merwe 2001,
  section 7.6).
* `stratified`: one draw in each of N equal strata (Kitagawa 1996).
* `systematic`: the same draw in all strata, ⌊N Wᵢ⌋ or ⌈N Wᵢ⌉ copies: minimum variance (Carpenter, Clifford & Fearnhead
  1999).

All take O(N): nothing is sorted, and only independent draws are searched for. A weight of zero has no copies.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from sigmapoint.compiled.native import running_max, running_sum
from sigmapoint.particles.weights import effective, even

__all__ = ["multinomial", "residual", "stratified", "systematic"]
Resampling = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class Resampler:
    """A scheme, and when it is time for it.

    Args:
        scheme: `(key, log_weights)` to ancestors.
        threshold: share of the particles below which the effective sample size asks for it.
    """

    scheme: Resampling
    threshold: float

    def due(self, log_weights: Float[Array, " N"]) -> Bool[Array, ""]:
        """Whether so few particles count that it is time."""
        return effective(log_weights) < self.threshold * log_weights.shape[0]

    def resampled(self, key: Array, log_weights: Float[Array, " N"], tree: Any) -> tuple[Any, Array, Array]:
        """Copies of what the particles have, the weights of these, all the same, and their ancestors."""
        ancestors = self.scheme(key, log_weights)
        copies = jax.tree.map(lambda a: a[ancestors], tree)
        return copies, even(log_weights.shape[0], log_weights.dtype), ancestors

    def where_due(self, key: Array, log_weights: Float[Array, " N"], tree: Any) -> tuple[Any, Array, Array]:
        """The same where it is time; else what there is, each its own ancestor."""
        here = jnp.arange(log_weights.shape[0], dtype=jnp.int32)
        return jax.lax.cond(
            self.due(log_weights),
            lambda: self.resampled(key, log_weights, tree),
            lambda: (tree, log_weights, here),
        )


def _cumulative(weights: Float[Array, " N"]) -> Float[Array, " N"]:
    """Sums of the weights up to each, exactly one at the end."""
    total = running_sum(weights)
    return total / total[-1]


def _weights(log_weights: Float[Array, " N"]) -> Float[Array, " N"]:
    """Up to a factor."""
    return jnp.exp(log_weights - jnp.max(log_weights))


def _ancestors(ends: Int[Array, " K"], weights: Float[Array, " K"], count: int) -> Int[Array, " N"]:
    """Who is copied where, from the number of copies up to and with each particle.

    Each is written where its copies begin, and holds up to the next.
    """
    begins = jnp.concatenate([jnp.zeros_like(ends[:1]), ends[:-1]])
    own = jnp.where((weights > 0) & (ends > begins), jnp.arange(ends.shape[0], dtype=ends.dtype), 0)
    return running_max(jnp.zeros(count, ends.dtype).at[begins].max(own, mode="drop"))


def systematic(key: Array, log_weights: Float[Array, " K"], count: int | None = None) -> Int[Array, " N"]:
    """One draw for all strata: the fewest changes of any scheme. `count` copies; as many as there were if not given.

    Examples:
        >>> import jax, jax.numpy as jnp, sigmapoint as sp
        >>> sp.resampling.systematic(jax.random.key(0), jnp.log(jnp.array([0.25, 0.75, 0.0, 0.0]))).tolist()
        [0, 1, 1, 1]
    """
    weights = _weights(log_weights)
    N = weights.shape[0] if count is None else count
    offset = jax.random.uniform(key, (), weights.dtype)
    ends = jnp.ceil(N * _cumulative(weights) - offset).astype(jnp.int32)
    return _ancestors(ends, weights, N)


def stratified(key: Array, log_weights: Float[Array, " N"]) -> Int[Array, " N"]:
    """A draw of its own in every stratum.

    Examples:
        >>> import jax, jax.numpy as jnp, sigmapoint as sp
        >>> sp.resampling.stratified(jax.random.key(0), jnp.log(jnp.array([0.5, 0.0, 0.5, 0.0]))).tolist()
        [0, 0, 2, 2]
    """
    weights = _weights(log_weights)
    N = weights.shape[0]
    offsets = jax.random.uniform(key, (N,), weights.dtype)
    reached = N * _cumulative(weights)
    whole = jnp.minimum(jnp.floor(reached), N - 1.0)
    stratum = whole.astype(jnp.int32)
    ends = stratum + (offsets[stratum] < reached - whole).astype(jnp.int32)
    return _ancestors(ends, weights, N)


def multinomial(key: Array, log_weights: Float[Array, " N"]) -> Int[Array, " N"]:
    """N independent draws.

    Examples:
        >>> import jax, jax.numpy as jnp, sigmapoint as sp
        >>> sp.resampling.multinomial(jax.random.key(0), jnp.log(jnp.array([0.0, 1.0, 0.0]))).tolist()
        [1, 1, 1]
    """
    weights = _weights(log_weights)
    N = weights.shape[0]
    ends = _below(_cumulative(weights), _sorted_uniforms(key, N, jnp.asarray(N), weights.dtype))
    return _ancestors(ends, weights, N)


def residual(key: Array, log_weights: Float[Array, " N"]) -> Int[Array, " N"]:
    """The whole part of N Wᵢ for certain, and independent draws for the rest.

    Examples:
        >>> import jax, jax.numpy as jnp, sigmapoint as sp
        >>> sp.resampling.residual(jax.random.key(0), jnp.log(jnp.array([0.5, 0.25, 0.25, 0.0]))).tolist()
        [0, 0, 1, 2]
    """
    weights = _weights(log_weights)
    N = weights.shape[0]
    expected = N * (weights / jnp.sum(weights))
    certain = jnp.floor(expected * (1 + 8 * jnp.finfo(expected.dtype).eps))  # a whole number up to round-off is one
    rest = jnp.maximum(expected - certain, 0.0)
    left = N - jnp.sum(certain.astype(jnp.int32))
    # Where nothing is left (up to round-off), any draw will do: none is counted.
    share = _cumulative(jnp.where(jnp.sum(rest) > 0, rest, jnp.ones_like(rest)))
    drawn = _below(share, _sorted_uniforms(key, N, left, weights.dtype))
    ends = jnp.cumsum(certain.astype(jnp.int32)) + drawn
    return _ancestors(ends.astype(jnp.int32), weights, N)


def _sorted_uniforms(key: Array, N: int, count: Int[Array, ""], dtype: jnp.dtype) -> Float[Array, " N"]:
    """`count` uniform draws in ascending order, and twos up to N: sums of exponential spacings."""
    spacings = jax.random.exponential(key, (N + 1,), dtype)
    sums = jnp.cumsum(spacings)
    return jnp.where(jnp.arange(N) < count, sums[:-1] / sums[count], 2.0)


def _below(bounds: Float[Array, " N"], draws: Float[Array, " N"]) -> Int[Array, " N"]:
    """How many of the ascending draws lie below each bound."""
    return jnp.searchsorted(draws, bounds, side="left").astype(jnp.int32)
