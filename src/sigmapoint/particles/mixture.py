"""A mixture of Gaussians as a belief: its density, draws of it, its moments, and fewer components in place of many."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sigmapoint.belief import symmetric
from sigmapoint.densities import LOG_2PI
from sigmapoint.linalg import cholesky, one_where_zero, solve_lower
from sigmapoint.particles.normals import normals
from sigmapoint.particles.weights import Cloud, moments
from sigmapoint.spaces import Space


class Mixture(NamedTuple):
    """G components, each with a mean, a lower factor of its covariance, and the logarithm of its weight."""

    log_weights: Float[Array, " G"]
    mean: Float[Array, "G d"]
    factor: Float[Array, "G n n"]

    @property
    def size(self) -> int:
        """Number of components."""
        return self.log_weights.shape[0]

    @property
    def covs(self) -> Float[Array, "G n n"]:
        """Covariance of each component."""
        return self.factor @ jnp.swapaxes(self.factor, 1, 2)

    def moments(self, space: Space) -> Cloud:
        """Mean, covariance and standard deviations of the whole: what is within components and between their means."""
        return together(self.log_weights, self.mean, self.covs, space)

    def draws(self, key: Array, of: Int[Array, " N"], space: Space) -> Float[Array, "N d"]:
        """One draw of each of the components named in `of`."""
        noise = normals(key, (of.shape[0], self.factor.shape[1]), self.mean.dtype)
        steps = jnp.sum(self.factor[of] * noise[:, None, :], axis=2)
        return jax.vmap(space.retract)(self.mean[of], steps)

    def log_densities(self, points: Float[Array, "N d"], space: Space) -> Float[Array, "G N"]:
        """Logarithm of the density of each component, without its weight, in the directions that have a variance."""

        def one(mean: Array, factor: Array) -> Array:
            off = jax.vmap(lambda x: space.residual(x, mean))(points)
            white = solve_lower(factor, off.T, many=True)
            return -0.5 * jnp.sum(white**2, axis=0) - _log_det(factor) - factor.shape[0] * LOG_2PI / 2

        return jax.vmap(one)(self.mean, self.factor)

    def log_density(self, points: Float[Array, "N d"], space: Space) -> Float[Array, " N"]:
        """Logarithm of the density of the whole."""
        return jax.nn.logsumexp(self.log_weights[:, None] + self.log_densities(points, space), axis=0)

    def reduced(self, size: int, space: Space) -> "Mixture":
        """At most `size` components: pair by pair, those are merged whose merger loses least (Runnalls 2007).

        The upper bound on the Kullback-Leibler divergence of a merger of i and j into one of the same moments is

            B = [(wᵢ + wⱼ) log |P| − wᵢ log |Pᵢ| − wⱼ log |Pⱼ|] / 2.
        """
        if self.size <= size:
            return self
        i, j = jnp.triu_indices(self.size, 1)

        def merge(_: Array, now: tuple[Mixture, Array]) -> tuple[Mixture, Array]:
            mixture, gone = now
            losses, mergers = jax.vmap(lambda i, j: _merger(mixture, i, j, space))(i, j)
            best = jnp.argmin(jnp.where(gone[i] | gone[j], jnp.inf, losses))
            mixture = jax.tree.map(lambda a, b: a.at[i[best]].set(b[best]), mixture, mergers)
            return mixture, gone.at[j[best]].set(True)

        mixture, gone = jax.lax.fori_loop(0, self.size - size, merge, (self, jnp.zeros(self.size, bool)))
        left = jnp.argsort(gone)[:size]
        return jax.tree.map(lambda a: a[left], mixture)


def _merger(mixture: Mixture, i: Array, j: Array, space: Space) -> tuple[Array, Mixture]:
    """What a merger loses, and what it leaves."""
    pair = jnp.stack([i, j])
    two: Mixture = jax.tree.map(lambda a: a[pair], mixture)
    total = jax.nn.logsumexp(two.log_weights)
    share = jnp.where(total > -jnp.inf, two.log_weights - total, -jnp.log(2.0))
    whole = together(share, two.mean, two.covs, space)
    one = Mixture(total, whole.mean, cholesky(whole.cov))
    loss = jnp.exp(total) * _log_det(one.factor) - jnp.exp(two.log_weights) @ jax.vmap(_log_det)(two.factor)
    return loss, one


def _log_det(factor: Float[Array, "n n"]) -> Float[Array, ""]:
    """Half the logarithm of the determinant of a covariance, of the directions that have a variance."""
    return jnp.sum(jnp.log(one_where_zero(jnp.diagonal(factor))))


def together(
    log_weights: Float[Array, " G"], means: Float[Array, "G d"], covs: Float[Array, "G n n"], space: Space
) -> Cloud:
    """Moments of weighted Gaussians: Σ w (C + (m − m̄)(m − m̄)ᵀ)."""
    between = moments(means, log_weights, space)
    cov = symmetric(between.cov + jnp.einsum("g,gij->ij", jnp.exp(log_weights), covs))
    return Cloud(between.mean, cov, jnp.sqrt(jnp.diagonal(cov)))
