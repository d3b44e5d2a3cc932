"""One step of a particle filter: particles are weighed by a measurement, and drawn ahead in time.

Source: Wan & van der Merwe (2001), Algorithm 7.6.1. Estimates are made before particles are resampled, from weights.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint.densities import finite_part
from sigmapoint.entering import NoiseSeries
from sigmapoint.model import StateSpaceModel
from sigmapoint.particles.instant import Instant, Surprise
from sigmapoint.particles.moves import Setting
from sigmapoint.particles.normals import normals
from sigmapoint.particles.proposal import Drawn, Prospect
from sigmapoint.particles.sampled import Draws
from sigmapoint.particles.selection import uneven
from sigmapoint.particles.state import Origin, ParticleInfo, ParticleState
from sigmapoint.particles.weights import effective, even, moments, weighed
from sigmapoint.system import System, initial

RESAMPLED, DRAWN, RESAMPLED_AGAIN, MOVED = range(4)
"""What random numbers are for."""


class ParticleFilter(NamedTuple):
    """A model made ready for a particle method."""

    model: StateSpaceModel
    method: Any
    process: NoiseSeries
    observation: NoiseSeries
    tools: Any
    key: Array | None

    @classmethod
    def of(cls, model: StateSpaceModel, method: Any, key: Array | None) -> "ParticleFilter":
        _, process, observation = System.of(model)
        return cls(model, method, process, observation, method.proposal.ready(model), key)

    @property
    def system(self) -> System:
        """The model and its noises."""
        return System(self.model, self.process, self.observation)

    def init(self) -> ParticleState:
        """Draws of the initial belief, at instant 0."""
        N, mean, space, draws = (
            self.method.particles,
            self.model.initial.mean,
            self.model.state_space,
            Draws.of(self.key),
        )
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
        state = method.selection.before_time(method, state.draws.key_for(RESAMPLED), state)
        noise = self.process.density(state.step).draws(state.draws.key_for(DRAWN), method.particles, normals)
        step = fs.process.drawn(fs.f, fs.state_space)
        particles, centre = jax.vmap(lambda x, w: step(x, u, w))(state.particles, noise)
        origin = Origin(centre, method.proposal.ahead(self.tools, state, u), jnp.ones((), bool))
        ahead = state.replace(particles=particles, origin=origin, draws=state.draws.after(), step=state.step + 1)
        return ahead.spread(method.over)

    def update(self, state: ParticleState, y: Float[Array, " e"], u: Any) -> tuple[ParticleState, ParticleInfo]:
        """Particles after a measurement; elements that are NaN were not measured."""
        method, at = self.method, Instant.of(self.system, state.step, y, u)
        prospect = method.proposal.prospect(self.tools, at, state)
        chosen = method.selection.before_drawing(method, state.draws.key_for(RESAMPLED), at, state, prospect)
        drawn = method.proposal.draw(at, state.draws.key_for(DRAWN), chosen.state, chosen.prospect)
        log_weights, log_likelihood = weighed(chosen.state.log_weights, drawn.log_ratio + chosen.log_first)
        explained = log_likelihood > -jnp.inf
        ess = jnp.where(explained, effective(log_weights), 0.0)
        info = ParticleInfo(*self._predicted(at, state), log_likelihood, ess)

        def taken_in() -> ParticleState:
            origin = chosen.state.origin._replace(proposal=drawn.memory)
            after = chosen.state.replace(particles=drawn.particles, log_weights=log_weights, origin=origin)
            return after if method.move is None else self._moved(at, after, chosen.prospect, drawn)

        after = jax.lax.cond(explained, taken_in, lambda: state)
        origin = after.origin._replace(fresh=after.origin.fresh & ~at.active.any())
        return after.replace(origin=origin, draws=state.draws.after()).spread(method.over), info

    def _predicted(self, at: Instant, state: ParticleState) -> Surprise:
        """The measurement as the particles predicted it."""
        space = at.functions.observation_space
        expected = moments(at.expected(state.particles), state.log_weights, space)
        noise: Any = self.observation.at(state.step)
        mean = space.retract(expected.mean, finite_part(noise.mean, 0.0))
        return at.surprise(mean, expected.cov + noise.spread.cov)

    def _moved(self, at: Instant, state: ParticleState, prospect: Prospect, drawn: Drawn) -> ParticleState:
        """Resampled where it is time to, and the copies moved apart."""
        method = self.method

        def apart() -> ParticleState:
            log_weights = even(method.particles, state.log_weights.dtype)
            ancestors = method.resampling(state.draws.key_for(RESAMPLED_AGAIN), state.log_weights)
            given, copies = jax.tree.map(lambda a: a[ancestors], (prospect, drawn))
            copied = state.chosen(ancestors, log_weights)
            setting = Setting(at, copied, method.proposal, given)
            return copied.replace(particles=method.move(state.draws.key_for(MOVED), setting, copies).particles)

        return jax.lax.cond(at.usable(state) & uneven(method, state.log_weights), apart, lambda: state)
