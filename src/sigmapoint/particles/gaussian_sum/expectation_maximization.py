"""A mixture of Gaussians from weighted points, by expectation-maximisation (Dempster, Laird & Rubin 1977).

    r_ig = π_g N(xᵢ; m_g, C_g) / Σ_h π_h N(xᵢ; m_h, C_h),   π_g = Σᵢ Wᵢ r_ig,   m_g = Σᵢ Wᵢ r_ig xᵢ / π_g,
    C_g = (Σᵢ Wᵢ r_ig (xᵢ − m_g)(xᵢ − m_g)ᵀ + ν B_g) / (π_g + ν).

Source: van der Merwe & Wan (2003), for the weights. The prior ν B_g, a share of the covariance B_g that the component
starts with, keeps one that has fallen on a single point from becoming one (after Fraley & Raftery 2007, who take that
of all points: where components are far apart it would widen those of little weight beyond all measure); ν = 1/ESS, as
many as one point.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint.linear_algebra.factors import cholesky
from sigmapoint.particles.gaussian_sum.mixture import Mixture
from sigmapoint.particles.weights import EXACT, effective
from sigmapoint.spaces import Space


def fitted(
    points: Float[Array, "N d"], log_weights: Float[Array, " N"], start: Mixture, iterations: int, space: Space
) -> Mixture:
    """The mixture after some iterations, from `start`. Components that no point belongs to keep their place."""
    weights = jnp.exp(log_weights)
    prior = 1 / effective(log_weights)
    tiny = jnp.finfo(points.dtype).tiny

    def step(mixture: Mixture, _: None) -> tuple[Mixture, None]:
        log_joint = mixture.log_weights[:, None] + mixture.log_densities(points, space)
        shares = weights[None] * jnp.exp(log_joint - jax.nn.logsumexp(log_joint, axis=0)[None])
        # A point beyond the reach of all components counts for none.
        return jax.vmap(maximized)(mixture, start.factor, jnp.where(jnp.isfinite(shares), shares, 0.0)), None

    def maximized(one: Mixture, before: Array, share: Array) -> Mixture:
        total = jnp.sum(share)
        known = total > tiny / jnp.finfo(points.dtype).eps
        own = jnp.where(known, share / jnp.where(known, total, 1.0), 0.0)
        off = jax.vmap(lambda x: space.residual(x, one.mean))(points)
        off = jnp.where(own[:, None] > 0, off, 0.0)
        shift = jnp.dot(own, off, precision=EXACT)
        apart = off - shift[None]
        within = jnp.dot((own[:, None] * apart).T, apart, precision=EXACT)
        factor = cholesky((total * within + prior * before @ before.T) / (total + prior))
        return Mixture(
            jnp.where(known, jnp.log(jnp.where(known, total, 1.0)), -jnp.inf),
            space.retract(one.mean, shift),
            jnp.where(known, factor, one.factor),
        )

    mixture, _ = jax.lax.scan(step, start, None, iterations)
    return mixture._replace(log_weights=jax.nn.log_softmax(mixture.log_weights))


def about(points: Float[Array, "G d"], cloud: Float[Array, "n n"]) -> Mixture:
    """A mixture to start from: components of the same weight about the points, as wide as fill a cloud's covariance."""
    G, n = points.shape[0], cloud.shape[0]
    factor = cholesky(cloud) / G ** (1 / n)
    even = jnp.full(G, -jnp.log(jnp.asarray(G, points.dtype)), points.dtype)
    return Mixture(even, points, jnp.broadcast_to(factor, (G, n, n)))
