"""What a particle filter knows at one instant, and what an update saw."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float, Int

from sigmapoint.devices import placed
from sigmapoint.particles.sampled import Sampled
from sigmapoint.particles.weights import Cloud, effective, moments

AXIS = "particles"


class Origin(NamedTuple):
    """What the particles of an instant were drawn from."""

    centre: Float[Array, "N d"]
    """where the noise was added: f(x[k−1], u[k−1]), or the initial mean"""
    proposal: Any
    """what the proposal remembers of each particle"""
    fresh: Bool[Array, ""]
    """no measurement has been taken in since"""


class ParticleState(Sampled):
    """What a particle filter knows at instant `step`: weighted draws of the state.

    Attributes:
        particles: (N, d), in the units of the state.
        log_weights: logarithms of their weights (N,), which sum to one.
        ancestors: for each, its place among the particles of the instant before (N,).
        origin: what they were drawn from.
        draws: where the filter is in its random numbers.
        step: the instant.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x[:1], jnp.eye(2), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(2), jnp.eye(2)))
        >>> state = sp.online(model, sp.bootstrap(100)).init(key=0)
        >>> state.particles.shape, state.mean.shape, state.cov.shape, round(float(state.ess))
        ((100, 2), (2,), (2, 2), 100)
    """

    particles: Float[Array, "N d"]
    ancestors: Int[Array, " N"]
    origin: Origin
    step: Int[Array, ""]

    @property
    def moments(self) -> Cloud:
        return moments(self.particles, self.log_weights, self.space)

    def spread(self, over: Mesh | None) -> "ParticleState":
        """The same, the particles spread over devices."""
        if over is None:
            return self
        N = self.log_weights.shape[0]

        def one(a: Array) -> Array:
            return placed(a, over, AXIS) if a.ndim and a.shape[0] == N else a

        return jax.tree.map(one, self)

    def chosen(self, ancestors: Int[Array, " N"], log_weights: Float[Array, " N"]) -> "ParticleState":
        """Copies of the ancestors, with weights of their own."""
        own, origin = jax.tree.map(
            lambda a: a[ancestors], ((self.particles, self.ancestors), self.origin._replace(fresh=None))
        )
        return self.replace(
            particles=own[0],
            ancestors=own[1],
            log_weights=log_weights,
            origin=origin._replace(fresh=self.origin.fresh),
        )


class Surprise(NamedTuple):
    """Innovation (NaN where nothing was measured), its covariance and NIS."""

    innovation: Float[Array, " m"]
    innovation_cov: Float[Array, "m m"]
    nis: Float[Array, ""]


class ParticleInfo(NamedTuple):
    """What an update saw; innovation, its covariance and NIS by the prediction made before.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> live = sp.online(model, sp.bootstrap(1000))
        >>> _, info = live.update(live.init(key=0), [2.0])
        >>> bool(0 < info.ess < 1000), bool(abs(info.log_likelihood + 2.27) < 0.2)
        (True, True)
    """

    innovation: Float[Array, " m"]
    """Measured minus predicted, in the units of the measurement; NaN where nothing was measured."""
    innovation_cov: Float[Array, "m m"]
    """Its covariance as predicted, in products of these units."""
    nis: Float[Array, ""]
    """Normalised innovation squared [1]: its mean is the number of elements measured, if the model is right."""
    log_likelihood: Float[Array, ""]
    """Natural logarithm of an estimate of the predicted density of what was measured: unbiased; consistent only of a
    Gaussian sum, whose mixtures are found in samples."""
    ess: Float[Array, ""]
    """Effective sample size after weighing; 0 where no particle explains the measurement (all weights were zero)."""

    @classmethod
    def of(
        cls, predicted: Surprise, log_likelihood: Float[Array, ""], log_weights: Float[Array, " N"]
    ) -> "ParticleInfo":
        """From the prediction, and what the measurement made of the weights."""
        ess = jnp.where(log_likelihood > -jnp.inf, effective(log_weights), 0.0)
        return cls(*predicted, log_likelihood, ess)
