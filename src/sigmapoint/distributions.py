"""Distributions of other libraries as densities, with their moments and their parts.

A noise may be any object with the interface of numpyro: `sample(key, shape)`, `log_prob`, `mean` and `variance`, and,
where it has them, `batch_shape` and `event_shape`, `covariance_matrix`, `support`, and the parts of a mixture.
"""

from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from sigmapoint.densities import Standard


@runtime_checkable
class Distribution(Protocol):
    """A distribution of another library (numpyro's interface)."""

    def sample(self, key: Any, sample_shape: Any = ()) -> Any: ...

    def log_prob(self, value: Any) -> Any: ...


class Given(NamedTuple):
    """A distribution of another library, about `centre`: the density of what is left when that is taken off."""

    distribution: Any
    centre: Float[Array, " q"]

    def draws(self, key: Array, count: int, standard: Standard = jax.random.normal) -> Float[Array, "N q"]:
        drawn = self.distribution.sample(key, (count,))
        return jnp.asarray(drawn, self.centre.dtype).reshape(count, -1) - self.centre[None]

    def log_density(self, values: Float[Array, "N q"], active: Bool[Array, " q"]) -> Float[Array, " N"]:
        batch, event = shape_of(self.distribution)
        shape = *batch, *event
        harmless = _inside(self.distribution, self.centre.dtype)
        known = jnp.where(active[None], values + self.centre[None], harmless[None])
        log_density = _supported(self.distribution, known.reshape(-1, *shape), harmless.reshape(shape))
        log_density = log_density.astype(values.dtype).reshape(values.shape[0], -1)
        if event:  # elements that depend on each other are known together or not at all
            return jnp.where(active.all(), log_density.sum(1), 0.0)
        return jnp.sum(jnp.where(active[None], log_density, 0.0), axis=1)


def _inside(distribution: Any, dtype: Any) -> Float[Array, " q"]:
    """A value inside the support, for elements whose density is of no account."""
    return jnp.asarray(distribution.sample(jax.random.key(0), ()), dtype).reshape(-1)


def _supported(distribution: Any, values: Array, harmless: Array) -> Array:
    """The logarithm of the density; minus infinity outside of the support, which not every distribution says."""
    support = getattr(distribution, "support", None)
    if support is None:
        return distribution.log_prob(values)
    inside = support(values)
    within = inside.reshape(*inside.shape, *(1 for _ in shape_of(distribution).event))
    return jnp.where(inside, distribution.log_prob(jnp.where(within, values, harmless[None])), -jnp.inf)


class Moments(NamedTuple):
    """Mean and covariance; infinite or NaN where a distribution has none."""

    mean: Float[Array, " q"]
    cov: Float[Array, "q q"]


def moments(distribution: Any) -> Moments:
    """Mean and covariance of a distribution, whatever shape it comes in.

    A mixture's covariance is that within its components and between their means: Σ π (C + m mᵀ) − m̄ m̄ᵀ.
    """
    try:
        mean = jnp.asarray(distribution.mean, float).reshape(-1)
    except NotImplementedError:  # as of a transformed one: nothing is known
        size = size_of(distribution)
        return Moments(jnp.full(size, jnp.nan), jnp.full((size, size), jnp.nan))
    parts = components(distribution)
    if parts is None:
        return Moments(mean, _covariance(distribution, mean.shape[0]))
    weights, each = parts
    means = jnp.stack([part.mean for part in each])
    apart = means - (weights @ means)[None]
    within = jnp.einsum("k,kij->ij", weights, jnp.stack([part.cov for part in each]))
    return Moments(weights @ means, within + jnp.einsum("k,ki,kj->ij", weights, apart, apart))


def components(distribution: Any) -> tuple[Array, list[Moments]] | None:
    """Weights and moments of the parts of a mixture of vectors; nothing where it is no such mixture."""
    mixing = getattr(distribution, "mixing_distribution", None)
    if mixing is None or shape_of(distribution).batch:
        return None
    weights = jnp.asarray(mixing.probs, float)
    parts = getattr(distribution, "component_distributions", None)
    if parts is not None:
        return weights, [moments(part) for part in parts]
    family = distribution.component_distribution
    means = jnp.asarray(family.mean, float).reshape(weights.shape[0], -1)
    covs = _covariances(family, *means.shape)
    return weights, [Moments(m, C) for m, C in zip(means, covs)]


def _covariance(distribution: Any, q: int) -> Float[Array, "q q"]:
    return _covariances(distribution, 1, q)[0]


def _covariances(distribution: Any, k: int, q: int) -> Float[Array, "k q q"]:
    """Of k distributions in one; the correlations of `covariance_matrix` with `variance`.

    (A multivariate Student-t gives its scale as covariance matrix, which is smaller than its covariance.)
    """
    variance = jnp.broadcast_to(jnp.asarray(distribution.variance, float).reshape(-1, q), (k, q))
    given = getattr(distribution, "covariance_matrix", None)
    if given is None:
        return jax.vmap(jnp.diag)(variance)
    given = jnp.broadcast_to(jnp.asarray(given, float).reshape(-1, q, q), (k, q, q))
    ratio = jnp.sqrt(variance / jnp.diagonal(given, axis1=1, axis2=2))
    return given * ratio[:, :, None] * ratio[:, None, :]


class Shape(NamedTuple):
    """Of independent draws, and of one of them."""

    batch: tuple[int, ...]
    event: tuple[int, ...]


def shape_of(distribution: Any) -> Shape:
    """As the distribution says, or else that of its mean, of independent elements."""
    if hasattr(distribution, "batch_shape"):
        return Shape(tuple(distribution.batch_shape), tuple(distribution.event_shape))
    return Shape(jnp.shape(distribution.mean), ())


def size_of(distribution: Any) -> int:
    """Number of elements."""
    batch, event = shape_of(distribution)
    return int(np.prod(batch + event, dtype=int))
