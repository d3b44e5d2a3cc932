"""A mixture of Gaussians as a belief: its density, draws of it, its moments, and fewer components in place of many."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sigmapoint.densities import LOG_2PI
from sigmapoint.linear_algebra.factors import cholesky, one_where_zero, solve_lower
from sigmapoint.particles.normals import normals
from sigmapoint.particles.weights import Cloud, together
from sigmapoint.spaces import Euclidean, Space

VECTORS = Euclidean()


class Mixture(NamedTuple):
    """G components, each with a mean, a lower factor of its covariance, and the logarithm of its weight.

    Of a whole series, each has the instant as a further leading axis.

    Examples:
        >>> import jax, jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x**2, 0.1 * jnp.eye(1), 0.1 * jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> post = sp.filter(model, jnp.full((3, 1), 4.0), method=sp.gspf(2000, 4), key=0, keep=("mixture",))
        >>> last = jax.tree.map(lambda a: a[-1], post.mixture)
        >>> density = jnp.exp(last.log_density(jnp.array([[-2.0], [0.0], [2.0]])))
        >>> bool(density[0] > 0.1), bool(density[1] < 0.1), bool(density[2] > 0.1)  # at −2 or at 2
        (True, True, True)
    """

    log_weights: Float[Array, "*T G"]
    mean: Float[Array, "*T G d"]
    factor: Float[Array, "*T G n n"]

    @property
    def size(self) -> int:
        """Number of components."""
        return self.log_weights.shape[-1]

    @property
    def cov(self) -> Float[Array, "*T G n n"]:
        """Covariance of each component, in products of the units of the state."""
        return self.factor @ jnp.matrix_transpose(self.factor)

    def moments(self, space: Space) -> Cloud:
        """Mean, covariance and standard deviations of the whole: what is within components and between their means."""
        return together(self.log_weights, self.mean, self.cov, space)

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

    def log_density(self, points: Any, space: Space = VECTORS) -> Float[Array, " N"]:
        """Logarithm of the density of the whole at points (N, d) of the state; `space` where that has angles."""
        each = self.log_densities(jnp.asarray(points, self.mean.dtype), space)
        return jax.nn.logsumexp(self.log_weights[:, None] + each, axis=0)

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
    whole = together(share, two.mean, two.cov, space)
    one = Mixture(total, whole.mean, cholesky(whole.cov))
    loss = jnp.exp(total) * _log_det(one.factor) - jnp.exp(two.log_weights) @ jax.vmap(_log_det)(two.factor)
    return loss, one


def _log_det(factor: Float[Array, "n n"]) -> Float[Array, ""]:
    """Half the logarithm of the determinant of a covariance, of the directions that have a variance."""
    return jnp.sum(jnp.log(one_where_zero(jnp.diagonal(factor))))
