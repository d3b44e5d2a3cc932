"""Gaussian-sum filters: a mixture of Gaussians as belief, each of its components a sigma-point filter.

Time takes each component on, with each of the process noise's; a measurement updates each, with each of the
observation noise's. From the mixture of what they become particles are drawn and weighed by the densities themselves,
and a mixture is found in them again (`recovery`). Source: van der Merwe & Wan, "Gaussian mixture sigma-point particle
filters" (2003); Kotecha & Djurić, "Gaussian sum particle filtering" (2003).
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sigmapoint.compiled.series import of_each
from sigmapoint.distributions import components
from sigmapoint.linear_algebra.factors import cholesky, solve_lower
from sigmapoint.model import StateSpaceModel
from sigmapoint.particles.gaussian_sum.expectation_maximization import about, fitted
from sigmapoint.particles.gaussian_sum.mixture import Mixture
from sigmapoint.particles.instant import Instant
from sigmapoint.particles.normals import normals
from sigmapoint.particles.sampled import Draws, Sampled
from sigmapoint.particles.state import ParticleInfo, Surprise
from sigmapoint.particles.weights import Cloud, even, together, weighed
from sigmapoint.step import Filter
from sigmapoint.system import initial

DRAWN = 0
"""What random numbers are for."""
SETTLED = 20
"""Iterations in which the mixture for the initial belief is found."""


class GaussianSumState(Sampled):
    """What a Gaussian-sum filter knows at instant `step`.

    Attributes:
        mixture: the belief: `log_weights` (G,), `mean` (G, d) and `factor` (G, n, n) of its components.
        particles: draws (N, d) that it was found in, in the units of the state.
        log_weights: logarithms of their weights (N,), which sum to one.
        draws: where the filter is in its random numbers.
        step: the instant.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x[:1], jnp.eye(2), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(2), jnp.eye(2)))
        >>> state = sp.online(model, sp.gmsppf(300, 3)).init(key=0)
        >>> state.mixture.mean.shape, state.particles.shape, state.cov.shape
        ((3, 2), (300, 2), (2, 2))
    """

    mixture: Mixture
    particles: Float[Array, "N d"]
    step: Int[Array, ""]

    @property
    def moments(self) -> Cloud:
        return self.mixture.moments(self.space)


class Part(NamedTuple):
    """A Gaussian filter for one component of a noise, and the logarithm of that one's weight."""

    log_weight: Float[Array, ""]
    filter: Filter


class GaussianSumFilter(NamedTuple):
    """A model made ready for a Gaussian-sum method."""

    method: Any
    whole: Filter
    """by the moments of the noises"""
    ahead: tuple[Part, ...]
    """for each component of the process noise"""
    given: tuple[Part, ...]
    """for each component of the observation noise"""
    key: Array | None

    @classmethod
    def of(cls, model: StateSpaceModel, method: Any, key: Array | None) -> "GaussianSumFilter":
        ahead, given = (_parts(model, method.method, name) for name in ("process_noise", "observation_noise"))
        return cls(method, Filter.of(model, method.method), ahead, given, key)

    @property
    def model(self) -> StateSpaceModel:
        """What is run."""
        return self.whole.model

    def init(self) -> GaussianSumState:
        """A mixture for the initial belief, at instant 0: found in draws that have just its moments."""
        N, G, space = self.method.particles, self.method.components, self.model.state_space
        belief, draws = self.model.initial, Draws.of(self.key)
        steps = initial(self.model).draws(draws.key_for(DRAWN), N, normals)
        steps = _with_covariance(steps, belief.cov.astype(steps.dtype))
        particles = jax.vmap(lambda step: space.retract(belief.mean, step))(steps)
        log_weights = even(N, belief.mean.dtype)
        start = about(particles[:: N // G][:G], belief.cov.astype(belief.mean.dtype))
        mixture = fitted(particles, log_weights, start, SETTLED, space)
        return GaussianSumState(
            mixture=mixture,
            particles=particles,
            log_weights=log_weights,
            draws=draws.after(),
            step=jnp.zeros((), int),
            space=space,
        )

    def predict(self, state: GaussianSumState, u: Any) -> GaussianSumState:
        """The mixture about the next instant, and draws of it."""

        def taken_on(part: Part) -> Mixture:
            def one(mean: Array, factor: Array) -> tuple[Array, Array]:
                belief = part.filter.predict(self._component(mean, factor, state.step), u).belief
                return belief.mean, belief.factor

            means, factors = of_each(one, state.mixture.mean, state.mixture.factor)
            return Mixture(state.mixture.log_weights + part.log_weight, means, factors)

        every = jax.tree.map(lambda *a: jnp.concatenate(a), *map(taken_on, self.ahead))
        mixture = every.reduced(self.method.components, state.space)
        alike = jax.tree.map(lambda a: a[None], mixture)
        sample = self.method.recovery.sample(
            state.draws.key_for(DRAWN), mixture, alike, self.method.particles, state.space
        )
        log_weights = weighed(jnp.zeros_like(sample.log_ratio), sample.log_ratio).log_weights
        return state.replace(
            mixture=mixture,
            particles=sample.particles,
            log_weights=log_weights,
            draws=state.draws.after(),
            step=state.step + 1,
        )

    def update(self, state: GaussianSumState, y: Float[Array, " e"], u: Any) -> tuple[GaussianSumState, ParticleInfo]:
        """The mixture after a measurement; elements that are NaN were not measured."""
        at = Instant.of(self.whole.system, state.step, y, u)
        method, space = self.method, state.space

        def updated(part: Part) -> Mixture:
            def one(log_weight: Array, mean: Array, factor: Array) -> Mixture:
                after, info = part.filter.update(self._component(mean, factor, state.step), y, u)
                log_weight = log_weight + part.log_weight + info.log_likelihood
                return Mixture(log_weight, after.belief.mean, after.belief.factor)

            return of_each(one, *state.mixture)

        proposal = jax.tree.map(lambda *a: jnp.stack(a), *map(updated, self.given))
        sample = method.recovery.sample(state.draws.key_for(DRAWN), state.mixture, proposal, method.particles, space)
        log_joint = sample.log_ratio + at.log_likelihood(sample.particles)
        log_weights, log_likelihood = weighed(jnp.zeros_like(log_joint), log_joint)
        active = at.active.any()

        def recovered() -> tuple[Mixture, Array, Array]:
            mixture = method.recovery.mixture(sample, log_weights, method.components, space)
            return mixture, sample.particles, log_weights

        mixture, particles, kept = jax.lax.cond(
            active & (log_likelihood > -jnp.inf), recovered, lambda: (state.mixture, state.particles, state.log_weights)
        )
        info = ParticleInfo.of(self._predicted(at, state), jnp.where(active, log_likelihood, 0.0), kept)
        after = {"mixture": mixture, "particles": particles, "log_weights": kept, "draws": state.draws.after()}
        return state.replace(**after), info

    def _component(self, mean: Array, factor: Array, step: Array) -> Any:
        """One component as a Gaussian filter knows it."""
        return self.whole.about(self.method.method.belief.from_root(mean, factor), step)

    def _predicted(self, at: Instant, state: GaussianSumState) -> Surprise:
        """The measurement as the mixture predicted it."""

        def one(mean: Array, factor: Array) -> tuple[Array, Array]:
            return self.whole.expected(self._component(mean, factor, state.step), at.y, at.u)

        means, covs = of_each(one, state.mixture.mean, state.mixture.factor)
        whole = together(state.mixture.log_weights, means, covs, at.functions.observation_space)
        return at.surprise(whole.mean, whole.cov)


def _with_covariance(steps: Float[Array, "N n"], cov: Float[Array, "n n"]) -> Float[Array, "N n"]:
    """Draws of mean zero, moved and stretched to have just this covariance; fewer than they take as they are."""
    N, n = steps.shape
    if n >= N:
        return steps
    apart = steps - steps.mean(0)[None]
    white = solve_lower(cholesky(apart.T @ apart / N), apart.T, many=True)
    return (cholesky(cov) @ white).T


def components_of(noise: Any) -> list[tuple[Any, Any]]:
    """Weight and noise of each component of a mixture; one and all of any other noise."""
    found = None if noise.distribution is None else components(noise.distribution)
    if found is None:
        return [(1.0, noise)]
    return [(weight, type(noise)(part.cov, part.mean)) for weight, part in zip(*found)]


def _parts(model: StateSpaceModel, method: Any, name: str) -> tuple[Part, ...]:
    """A filter for each component of a noise."""

    def part(weight: Any, noise: Any) -> Part:
        one = eqx.tree_at(lambda m: getattr(m, name), model, noise)
        return Part(jnp.log(jnp.asarray(weight, model.initial.mean.dtype)), Filter.of(one, method))

    return tuple(part(*each) for each in components_of(getattr(model, name)))
