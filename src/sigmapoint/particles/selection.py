"""Selection: when, and by which weights, particles are chosen.

* `Afterwards`: before time passes, by their weights, where these have become uneven.
* `Ahead`: when the next measurement is there, by how well it can be reached from each: the auxiliary particle filter
  (Pitt & Shephard 1999). A particle is chosen with weight W p̂(y[k] | x[k−1]), and p̂ is divided out again of what it
  becomes. With the locally optimal proposal p̂ is what it becomes, and all weigh the same: fully adapted.
"""

from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint.particles.instant import Instant
from sigmapoint.particles.proposals.proposal import Prospect
from sigmapoint.particles.resampling import Resampler
from sigmapoint.particles.state import ParticleState
from sigmapoint.particles.weights import weighed


class Selected(NamedTuple):
    """Particles, what the measurement makes of them, and the logarithm of what to multiply their weights by."""

    state: ParticleState
    prospect: Prospect
    log_first: Float[Array, " N"]


@runtime_checkable
class Selection(Protocol):
    """When particles are chosen."""

    def before_time(self, resampler: Resampler, key: Array, state: ParticleState, /) -> ParticleState:
        """The particles that go on to the next instant."""
        ...

    def before_drawing(
        self, resampler: Resampler, key: Array, at: Instant, state: ParticleState, prospect: Prospect, /
    ) -> Selected:
        """The particles whose origins are drawn from, in the light of the measurement."""
        ...


@dataclass(frozen=True)
class Afterwards:
    """By their weights."""

    def before_time(self, resampler: Resampler, key: Array, state: ParticleState) -> ParticleState:
        carried = state.particles, state.origin.proposal
        (particles, memory), log_weights, ancestors = resampler.where_due(key, state.log_weights, carried)
        origin = state.origin._replace(proposal=memory)
        return state.replace(particles=particles, ancestors=ancestors, log_weights=log_weights, origin=origin)

    def before_drawing(
        self, resampler: Resampler, key: Array, at: Instant, state: ParticleState, prospect: Prospect
    ) -> Selected:
        return Selected(state, prospect, jnp.zeros_like(state.log_weights))


@dataclass(frozen=True)
class Ahead:
    """By the next measurement."""

    def before_time(self, resampler: Resampler, key: Array, state: ParticleState) -> ParticleState:
        return state.replace(ancestors=jnp.arange(state.log_weights.shape[0], dtype=jnp.int32))

    def before_drawing(
        self, resampler: Resampler, key: Array, at: Instant, state: ParticleState, prospect: Prospect
    ) -> Selected:
        first = weighed(state.log_weights, prospect.log_density)
        useful = at.usable(state) & (first.log_total > -jnp.inf) & resampler.due(first.log_weights)

        def chosen() -> Selected:
            given, log_weights, ancestors = resampler.resampled(key, first.log_weights, prospect)
            return Selected(state.chosen(ancestors, log_weights), given, first.log_total - given.log_density)

        return jax.lax.cond(useful, chosen, lambda: Selected(state, prospect, jnp.zeros_like(state.log_weights)))
