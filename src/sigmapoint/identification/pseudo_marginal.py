"""Metropolis–Hastings with a likelihood that is estimated, p̂(y | θ), in place of one that is known.

    accept z' = z + step with probability min(1, p̂(y | z') p(z') / (p̂(y | z) p(z)))

With an estimate that is unbiased, as a particle filter's is, the chain has the exact posterior for its distribution,
for any number of particles: its state is z together with the estimate that was made there, which stays as long as z
does. (Made anew at every step, it would be another chain, with another distribution.)

Source: Andrieu, Doucet & Holenstein, J. R. Stat. Soc. B 72 (2010) 269, section 2.4.2; Andrieu & Roberts, Ann. Stat. 37
(2009) 697.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.compiled.series import of_each
from sigmapoint.identification.likelihood import LogPosterior

random_walk: Any = checks.extra("blackjax.mcmc.random_walk", "sampling", "mcmc")

KERNEL = random_walk.build_rmh()


class Point(NamedTuple):
    """Parameters, and what a run of the filter has made of them."""

    z: Float[Array, "*N L"]
    log_likelihood: Float[Array, "*N"]
    """as that run has estimated it"""
    ahead: Any = None
    """what the filter then knows of the next instant, where that is needed"""


def log_density(posterior: LogPosterior, point: Point) -> Float[Array, ""]:
    """Logarithm of the posterior's density up to a constant, as estimated; minus infinity where there is none."""
    value = point.log_likelihood + posterior.log_prior(point.z)
    return jnp.where(jnp.isfinite(value), value, -jnp.inf)


def moved(
    key: Array,
    posterior: LogPosterior,
    point: Point,
    step: Float[Array, " L"],
    estimate: Callable[[Array, Array], Point],
) -> tuple[Point, Any]:
    """The chain after it was offered `point.z + step`, whose density `estimate(z, key)` finds; and blackjax's info."""
    state = random_walk.RWState(point, log_density(posterior, point))
    state, info = KERNEL(
        key,
        state,
        lambda candidate: log_density(posterior, candidate),
        lambda key, at: estimate(at.z + step, key),
    )
    return state.position, info


@eqx.filter_jit
def estimated(posterior: LogPosterior, z: Float[Array, "K L"], keys: Array) -> Point:
    """Estimates at given parameters, each by its own key."""
    return of_each(lambda z, key: Point(z, posterior.log_likelihood(z, key)), z, keys)
