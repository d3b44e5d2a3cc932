"""Chains of Metropolis–Hastings whose steps learn the shape of the posterior in the warm-up.

    step = S u,  u ~ N(0, I),        S Sᵀ ← S (I + η (α − α*) u uᵀ / |u|²) Sᵀ

α being the probability with which the step was accepted. Steps get longer along directions in which more of them are
accepted than α*, shorter along the others, the less the later; after the warm-up, η = 0, they are as they are.

Source: Vihola, "Robust adaptive Metropolis algorithm with coerced acceptance rate", Stat. Comput. 22 (2012) 997.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from sigmapoint.compiled.series import of_each
from sigmapoint.identification.likelihood import LogPosterior
from sigmapoint.identification.pseudo_marginal import Point, moved

ACCEPTED = 0.15
"""Share of steps to be accepted. A random walk of many parameters does best with 0.23 where the likelihood is exact,
with 0.07 where its logarithm has a variance of 3.3 (Sherlock, Thiery, Roberts & Rosenthal, Ann. Stat. 43 (2015) 238).
"""
FIRST = 0.1
"""Steps at the beginning, in deviations of the prior: they grow faster than they shrink."""
DECAY = 0.6
"""How fast the gain falls with the number of the step."""


class Chain(NamedTuple):
    """Where a chain is, and the factor of its steps' covariance."""

    point: Point
    factor: Float[Array, "*C L L"]


class Walked(NamedTuple):
    """What chains went through."""

    z: Float[Array, "C B L"]
    log_likelihood: Float[Array, "C B"]
    accepted: Bool[Array, "C B"]


def gains(warmup: int, steps: int, size: int) -> Float[np.ndarray, " steps"]:
    """How much each step teaches: min(1, L k^(−0.6)), and nothing after the warm-up."""
    number = np.arange(1, steps + 1)
    return np.where(number <= warmup, np.minimum(1.0, size * number**-DECAY), 0.0)


def learned(
    factor: Float[Array, "L L"], u: Float[Array, " L"], gain: Float[Array, ""], accepted: Float[Array, ""]
) -> Float[Array, "L L"]:
    """The factor after a step. The root of I + c v vᵀ with |v| = 1 is I + (√(1 + c) − 1) v vᵀ."""
    c = gain * (accepted - ACCEPTED)
    v = u / jnp.linalg.norm(u)
    return factor + (jnp.sqrt(1 + c) - 1) * (factor @ v)[:, None] * v[None, :]


def begun(posterior: LogPosterior, points: Point) -> Chain:
    """Chains at these points, before they have learned anything."""
    factor = FIRST * jnp.linalg.cholesky(posterior.unknowns.prior.cov)
    return Chain(points, jnp.broadcast_to(factor, (points.z.shape[0], *factor.shape)))


@eqx.filter_jit
def walked(posterior: LogPosterior, chains: Chain, keys: Array, gain: Float[Array, " B"]) -> tuple[Chain, Walked]:
    """Chains after as many steps as there are gains, and where they have been."""

    def estimate(z: Array, key: Array) -> Point:
        return Point(z, posterior.log_likelihood(z, key))

    def one(chain: Chain, key: Array) -> tuple[Chain, Walked]:
        def step(chain: Chain, row: tuple[Array, Array]) -> tuple[Chain, Any]:
            gain, (walk, draw) = row[0], jax.random.split(row[1])
            u = jax.random.normal(walk, chain.point.z.shape, chain.point.z.dtype)
            point, info = moved(draw, posterior, chain.point, chain.factor @ u, estimate)
            factor = learned(chain.factor, u, gain, info.acceptance_rate)
            return Chain(point, factor), Walked(point.z, point.log_likelihood, info.is_accepted)

        return jax.lax.scan(step, chain, (gain, jax.random.split(key, gain.shape[0])))

    return of_each(one, chains, keys)
