"""How a Gaussian-sum filter draws from its proposal, and finds a mixture again in the particles.

* `ByComponent` (Kotecha & Djurić 2003): as many particles of each component, weighed against its own prediction; each
  becomes the Gaussian of their moments.
* `ByExpectationMaximization` (van der Merwe & Wan 2003): particles of the mixture as a whole, weighed against the
  prediction as a whole; of them a mixture that explains them best.

A proposal has one Gaussian for each component of the prediction and of the observation noise, (J, G).
"""

from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sigmapoint.linear_algebra.factors import cholesky
from sigmapoint.particles.gaussian_sum.expectation_maximization import fitted
from sigmapoint.particles.gaussian_sum.mixture import Mixture
from sigmapoint.particles.resampling import systematic
from sigmapoint.particles.weights import effective, moments, weighed
from sigmapoint.spaces import Space


class Sample(NamedTuple):
    """Particles of a proposal."""

    particles: Float[Array, "N d"]
    log_ratio: Float[Array, " N"]
    """logarithm of the density predicted over that drawn from, divided by their number"""
    proposal: Mixture
    """what they were drawn from"""
    of: Int[Array, " N"]
    """the component that each is a draw of"""


@runtime_checkable
class Recovery(Protocol):
    """See the module. Hashable."""

    def sample(self, key: Array, predicted: Mixture, proposal: Mixture, count: int, space: Space, /) -> Sample:
        """Particles of a proposal for what is predicted."""
        ...

    def mixture(self, sample: Sample, log_weights: Float[Array, " N"], size: int, space: Space, /) -> Mixture:
        """A mixture of `size` components for weighted particles."""
        ...


@dataclass(frozen=True)
class ByComponent:
    """Each component for itself. Several proposals for one share its posterior, each where it is the higher."""

    def sample(self, key: Array, predicted: Mixture, proposal: Mixture, count: int, space: Space) -> Sample:
        every = flat(proposal)
        of = jnp.arange(count) * every.size // count
        parent = jnp.arange(every.size) % predicted.size
        particles = every.draws(key, of, space)
        number = jnp.bincount(of, length=every.size).astype(particles.dtype)
        siblings = parent[:, None] == parent[of][None]
        drawn_from = jnp.where(siblings, jnp.log(number)[:, None] + every.log_densities(particles, space), -jnp.inf)
        before = predicted.log_weights[:, None] + predicted.log_densities(particles, space)
        own = jnp.take_along_axis(before, parent[of][None], axis=0)[0]
        return Sample(particles, own - jax.nn.logsumexp(drawn_from, axis=0), every, of)

    def mixture(self, sample: Sample, log_weights: Float[Array, " N"], size: int, space: Space) -> Mixture:
        def one(k: Array, before: Array) -> Mixture:
            own = sample.of == k
            alike = jnp.where(own, -jnp.log(jnp.sum(own, dtype=log_weights.dtype)), -jnp.inf)
            share, total = weighed(alike, jnp.where(own, log_weights, -jnp.inf))
            cloud, prior = moments(sample.particles, share, space), 1 / effective(share)
            cov = (cloud.cov + prior * before @ before.T) / (1 + prior)
            return Mixture(total - jnp.max(alike), cloud.mean, cholesky(cov))

        parts = jax.vmap(one)(jnp.arange(sample.proposal.size), sample.proposal.factor)
        return parts.reduced(size, space)


@dataclass(frozen=True)
class ByExpectationMaximization:
    """All components together, from where the proposal has them."""

    iterations: int

    def sample(self, key: Array, predicted: Mixture, proposal: Mixture, count: int, space: Space) -> Sample:
        whole = flat(proposal)
        whole = whole._replace(log_weights=jax.nn.log_softmax(whole.log_weights))
        for_places, for_draws = jax.random.split(key)
        of = systematic(for_places, whole.log_weights, count)
        particles = whole.draws(for_draws, of, space)
        log_ratio = predicted.log_density(particles, space) - whole.log_density(particles, space)
        return Sample(particles, log_ratio - jnp.log(jnp.asarray(count, particles.dtype)), whole, of)

    def mixture(self, sample: Sample, log_weights: Float[Array, " N"], size: int, space: Space) -> Mixture:
        start = sample.proposal.reduced(size, space)
        return fitted(sample.particles, log_weights, start, self.iterations, space)


def flat(proposal: Mixture) -> Mixture:
    """A proposal as one mixture."""
    return Mixture(*(a.reshape(-1, *a.shape[2:]) for a in proposal))
