"""One step of a particle filter: particles are weighed by a measurement, and drawn ahead in time.

Source: Wan & van der Merwe (2001), Algorithm 7.6.1. Estimates are made before particles are resampled, from weights.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint.densities import finite_part
from sigmapoint.model import StateSpaceModel
from sigmapoint.particles.instant import Instant
from sigmapoint.particles.moves import Setting
from sigmapoint.particles.normals import normals
from sigmapoint.particles.proposals.proposal import Drawn, Prospect
from sigmapoint.particles.sampled import Draws
from sigmapoint.particles.state import Origin, ParticleInfo, ParticleState, Surprise
from sigmapoint.particles.weights import even, moments, weighed
from sigmapoint.system import System, initial

RESAMPLED, DRAWN, RESAMPLED_AGAIN, MOVED = range(4)
"""What random numbers are for."""


class ParticleFilter(NamedTuple):
    """A model made ready for a particle method."""

    system: System
    method: Any
    tools: Any
    key: Array | None

    @classmethod
    def of(cls, model: StateSpaceModel, method: Any, key: Array | None) -> "ParticleFilter":
        return cls(System.of(model), method, method.proposal.ready(model), key)

    @property
    def model(self) -> StateSpaceModel:
        """What is run."""
        return self.system.model

    def init(self) -> ParticleState:
        """Draws of the initial belief, at instant 0."""
        N, draws = self.method.particles, Draws.of(self.key)
        mean, space = self.model.initial.mean, self.model.state_space
        steps = initial(self.model).draws(draws.key_for(DRAWN), N, normals)
        particles = jax.vmap(lambda step: space.retract(mean, step))(steps)
        centre = jnp.broadcast_to(mean, particles.shape)
        state = ParticleState(
            particles=particles,
            log_weights=even(N, mean.dtype),
            ancestors=jnp.arange(N, dtype=jnp.int32),
            origin=Origin(centre, self.method.proposal.start(self.tools, N), jnp.ones((), bool)),
            draws=draws.after(),
            step=jnp.zeros((), int),
            space=space,
        )
        return state.spread(self.method.over)

    def predict(self, state: ParticleState, u: Any) -> ParticleState:
        """Particles drawn for the next instant, of those that are worth it."""
        fs, method = self.system.functions(state.step), self.method
        state = method.selection.before_time(method.resampler, state.draws.key_for(RESAMPLED), state)
        noise = self.system.process.density(state.step).draws(state.draws.key_for(DRAWN), method.particles, normals)
        step = fs.process.drawn(fs.f, fs.state_space)
        particles, centre = jax.vmap(lambda x, w: step(x, u, w))(state.particles, noise)
        origin = Origin(centre, method.proposal.ahead(self.tools, state, u), jnp.ones((), bool))
        ahead = state.replace(particles=particles, origin=origin, draws=state.draws.after(), step=state.step + 1)
        return ahead.spread(method.over)

    def update(self, state: ParticleState, y: Float[Array, " e"], u: Any) -> tuple[ParticleState, ParticleInfo]:
        """Particles after a measurement; elements that are NaN were not measured."""
        method, at = self.method, Instant.of(self.system, state.step, y, u)
        prospect = method.proposal.prospect(self.tools, at, state)
        key = state.draws.key_for(RESAMPLED)
        chosen = method.selection.before_drawing(method.resampler, key, at, state, prospect)
        drawn = method.proposal.draw(at, state.draws.key_for(DRAWN), chosen.state, chosen.prospect)
        log_weights, log_likelihood = weighed(chosen.state.log_weights, drawn.log_ratio + chosen.log_first)
        info = ParticleInfo.of(self._predicted(at, state), log_likelihood, log_weights)

        def taken_in() -> ParticleState:
            origin = chosen.state.origin._replace(proposal=drawn.memory)
            after = chosen.state.replace(particles=drawn.particles, log_weights=log_weights, origin=origin)
            return after if method.move is None else self._moved(at, after, chosen.prospect, drawn)

        after = jax.lax.cond(log_likelihood > -jnp.inf, taken_in, lambda: state)
        origin = after.origin._replace(fresh=after.origin.fresh & ~at.active.any())
        return after.replace(origin=origin, draws=state.draws.after()).spread(method.over), info

    def _predicted(self, at: Instant, state: ParticleState) -> Surprise:
        """The measurement as the particles predicted it."""
        space = at.functions.observation_space
        expected = moments(at.expected(state.particles), state.log_weights, space)
        noise: Any = self.system.observation.at(state.step)
        mean = space.retract(expected.mean, finite_part(noise.mean, 0.0))
        return at.surprise(mean, expected.cov + noise.spread.cov)

    def _moved(self, at: Instant, state: ParticleState, prospect: Prospect, drawn: Drawn) -> ParticleState:
        """Resampled where it is time to, and the copies moved apart."""
        method = self.method

        def apart() -> ParticleState:
            key = state.draws.key_for(RESAMPLED_AGAIN)
            (given, copies), log_weights, ancestors = method.resampler.resampled(
                key, state.log_weights, (prospect, drawn)
            )
            copied = state.chosen(ancestors, log_weights)
            setting = Setting(at, copied, method.proposal, given)
            return copied.replace(particles=method.move(state.draws.key_for(MOVED), setting, copies).particles)

        return jax.lax.cond(at.usable(state) & method.resampler.due(state.log_weights), apart, lambda: state)
