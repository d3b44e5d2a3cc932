"""The optimum of a log-posterior and the ridge through it, each as one compiled program.

Everything is done for s = (z - m) / d, in units of the prior deviations d.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from sigmapoint.identification.curvature import Curvature
from sigmapoint.identification.likelihood import LogPosterior
from sigmapoint.identification.search import bfgs, minimum

REACH = 3.0
"""Standard deviations to either side that a profile goes."""


def _scaled(posterior: LogPosterior) -> tuple[Callable[[Array], Array], Array]:
    """The negative log-density of s = (z - m) / d, in the accuracy of the model, and d, the prior deviations."""
    d, dtype = jnp.sqrt(jnp.diagonal(posterior.unknowns.prior.cov)), posterior.y.dtype
    return lambda s: -posterior(posterior.start + d * s.astype(d.dtype)).astype(dtype), d


@eqx.filter_jit
def fitted(posterior: LogPosterior, steps: int) -> tuple[Array, Array, Array, Array, Array]:
    """z, its covariance, the log-likelihood, what is left to go [standard deviations] and the steps taken."""
    f, d = _scaled(posterior)
    found = minimum(f, jnp.zeros(d.shape, posterior.y.dtype), _count(posterior), steps)
    curvature = Curvature.of(found.hessian)
    z = posterior.start + d * found.s.astype(d.dtype)
    cov = curvature.cov.astype(d.dtype) * (d[:, None] * d[None, :])
    log_likelihood = jnp.where(jnp.isfinite(found.value), posterior.log_likelihood(z), -jnp.inf)
    return z, cov, log_likelihood, curvature.distance(found.gradient), found.steps


def _count(posterior: LogPosterior) -> Array:
    return jnp.sum(~jnp.isnan(posterior.y), dtype=posterior.y.dtype)


@eqx.filter_jit
def profiled(posterior: LogPosterior, z: Array, cov: Array, i: Array, points: int) -> tuple[Array, Array]:
    """z along its element i, and the log-density there, both (points, ...)."""
    f, d = _scaled(posterior)
    at = (z - posterior.start) / d
    scaled = cov / (d[:, None] * d[None, :])
    std = jnp.sqrt(scaled[i, i])
    slope = jnp.nan_to_num(scaled[:, i] / scaled[i, i]).at[i].set(1.0)
    reach = REACH * jnp.where(jnp.isfinite(std), std, 1.0)

    def one(step: Array) -> tuple[Array, Array]:
        start = (at + slope * step).astype(posterior.y.dtype)

        def held(others: Array) -> Array:
            return f(others.at[i].set(start[i]))

        best = bfgs(held, start, _count(posterior), 100)[0]
        return posterior.start + d * best.at[i].set(start[i]).astype(d.dtype), -held(best)

    return jax.lax.map(one, jnp.linspace(-reach, reach, points))
