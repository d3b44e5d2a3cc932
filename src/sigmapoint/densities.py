"""What a noise is as a density: draws of it, and the logarithm of its density.

Gaussian filters need the first two moments of a noise only, particle filters and `simulate` all of it. A noise is given
as these moments, or as a distribution: any object with the interface of numpyro, `sample(key, shape)`, `log_prob`,
`mean` and `variance`, and, where it has them, `batch_shape` and `event_shape`, `covariance_matrix`, `support`, and the
parts of a mixture.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Scalar

from sigmapoint.belief import Spread
from sigmapoint.linalg import cholesky, solve_lower
from sigmapoint.native import LARGEST

LOG_2PI = 1.8378770664093453
Standard = Callable[[Array, tuple[int, ...], Any], Array]


@runtime_checkable
class Distribution(Protocol):
    """A distribution of another library (numpyro's interface)."""

    def sample(self, key: Any, sample_shape: Any = ()) -> Any: ...

    def log_prob(self, value: Any) -> Any: ...


@runtime_checkable
class Density(Protocol):
    """A density of a vector of q elements; `standard` draws standard normal numbers where it is made of them."""

    def draws(self, key: Array, count: int, standard: Standard = jax.random.normal, /) -> Float[Array, "N q"]: ...

    def log_density(self, values: Float[Array, "N q"], active: Bool[Array, " q"], /) -> Float[Array, " N"]:
        """Of the elements that are active, the others left out of account."""
        ...


class Normal(NamedTuple):
    """A Gaussian density."""

    mean: Float[Array, " q"]
    spread: Spread
    whitening: Float[Array, "q q"]
    """inverse of the factor; as `whitening(cov)` gives it"""

    def draws(self, key: Array, count: int, standard: Standard = jax.random.normal) -> Float[Array, "N q"]:
        noise = standard(key, (count, self.mean.shape[0]), self.mean.dtype)
        return self.mean[None] + rows_times(self.spread.factor, noise)

    def log_density(self, values: Float[Array, "N q"], active: Bool[Array, " q"]) -> Float[Array, " N"]:
        q, dtype = self.mean.shape[0], values.dtype
        pairs = active[:, None] & active[None, :]
        W = jax.lax.cond(
            active.all(),
            lambda: self.whitening,
            lambda: whitening(jnp.where(pairs, self.spread.cov, jnp.eye(q, dtype=dtype))),
        )
        off = rows_times(W, jnp.where(active[None], values - self.mean[None], 0.0))
        constant = jnp.sum(jnp.log(jnp.diagonal(W))) - jnp.sum(active, dtype=dtype) * LOG_2PI / 2
        return constant - 0.5 * jnp.sum(off**2, axis=1)


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


def whitening(cov: Float[Array, "q q"]) -> Float[Array, "q q"]:
    """The inverse of its lower factor."""
    return solve_lower(cholesky(cov), jnp.eye(cov.shape[0], dtype=cov.dtype))


def rows_times(A: Float[Array, "q q"], rows: Float[Array, "N q"]) -> Float[Array, "N q"]:
    """Every row multiplied by a lower triangular matrix; a small one as sums, which vectorise over the rows."""
    q = rows.shape[1]
    if q > LARGEST // 2:
        return rows @ A.T
    columns = [sum(rows[:, j] * A[i, j] for j in range(i + 1)) for i in range(q)]
    return jnp.stack(columns, axis=1)


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


def finite_part(value: Scalar | Array, otherwise: float) -> Array:
    """`value` where it is finite."""
    return jnp.where(jnp.isfinite(value), value, otherwise)
