"""One instant as proposals, selections and moves see it: densities of states and of the measurement."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from sigmapoint.carry import Functions
from sigmapoint.linear_algebra.factors import cholesky, solve_lower
from sigmapoint.particles.normals import normals
from sigmapoint.particles.state import ParticleState, Surprise
from sigmapoint.system import System, initial, measured


class Instant(NamedTuple):
    """A measurement, and the model at its instant."""

    system: System
    step: Int[Array, ""]
    functions: Functions
    y: Float[Array, " e"]
    u: Any
    active: Bool[Array, " m"]

    @classmethod
    def of(cls, system: System, step: Int[Array, ""], y: Float[Array, " e"], u: Any) -> "Instant":
        fs = system.functions(step, y.shape)
        active = measured(y, jax.eval_shape(fs.observation_space.residual, y, y).shape[0])
        return cls(system, step, fs, y, u, active)

    def expected(self, points: Float[Array, "N d"]) -> Float[Array, "N e"]:
        """What would be measured at each point, but for the noise."""
        return jax.vmap(lambda x: self.functions.h(x, self.u))(points)

    def surprise(self, mean: Float[Array, " e"], S: Float[Array, "m m"]) -> Surprise:
        """The measurement beside its prediction, the noise included."""
        innovation = self.functions.innovation(self.y, mean, self.active)
        # What has no finite variance surprises nobody.
        informative = self.active & jnp.isfinite(jnp.diagonal(S))
        pairs = informative[:, None] & informative[None, :]
        factor = cholesky(jnp.where(pairs, S, jnp.eye(S.shape[0], dtype=S.dtype)))
        nis = jnp.sum(solve_lower(factor, jnp.where(informative, innovation, 0.0)) ** 2)
        return Surprise(jnp.where(self.active, innovation, jnp.nan), S, nis)

    def log_likelihood(self, points: Float[Array, "N d"]) -> Float[Array, " N"]:
        """Logarithm of the density of the measurement at each point; 0 where nothing was measured."""
        fs = self.functions
        off = jax.vmap(lambda h: fs.innovation(self.y, h, self.active))(self.expected(points))
        return self.system.observation.density(self.step).log_density(off, self.active)

    def log_prior(self, points: Float[Array, "N d"], centre: Float[Array, "N d"]) -> Float[Array, " N"]:
        """Logarithm of the density of points that noise has taken from the `centre` of their origin."""
        off = jax.vmap(self.functions.state_space.residual)(points, centre)
        every = jnp.ones(off.shape[1], bool)
        return self._by_source(lambda density: density.log_density(off, every))

    def from_prior(self, key: Array, centre: Float[Array, "N d"]) -> Float[Array, "N d"]:
        """Points drawn from the model, without regard to the measurement."""
        N = centre.shape[0]
        steps = self._by_source(lambda density: density.draws(key, N, normals))
        return jax.vmap(self.functions.state_space.retract)(centre, steps)

    def usable(self, state: ParticleState) -> Bool[Array, ""]:
        """Something was measured, and the particles are still distributed as their origin says."""
        return state.origin.fresh & self.active.any()

    def _by_source(self, of: Any) -> Any:
        """`of` the initial density at instant 0, of the process noise of the step before at others."""
        first, later = initial(self.system.model), self.system.process.density(self.step - 1)
        return jax.lax.cond(self.step == 0, lambda: of(first), lambda: of(later))
