"""Gaussian proposals: a Gaussian filter of this library for every particle, its posterior drawn from.

Source: Wan & van der Merwe (2001), equations 7.110 to 7.119, after de Freitas et al. (2000) and van der Merwe et al.
(2000). Every particle is the mean of a Gaussian, predicted and updated with the new measurement; the particle is drawn
from the outcome. How wide a particle is before its step:

* `carried`, as in the papers: the covariance its filter was left with, as if the particle were an estimate.
* `guided`: none, as the particle is a hypothesis, taken at its word. The outcome is p(x[k] | x[k−1], y[k]), the locally
  optimal proposal (Doucet, Godsill & Andrieu 2000), up to the method's linearisation of h.
"""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint.belief import Belief
from sigmapoint.compiled.series import of_each
from sigmapoint.densities import LOG_2PI
from sigmapoint.methods import gaussian_filter
from sigmapoint.model import StateSpaceModel
from sigmapoint.particles.instant import Instant
from sigmapoint.particles.normals import normals
from sigmapoint.particles.proposals.proposal import (
    Covariance,
    Drawn,
    Prospect,
    covariance,
    require_densities,
    where_usable,
    with_covariance,
)
from sigmapoint.particles.state import ParticleState
from sigmapoint.spaces import Space, same_elements
from sigmapoint.step import Filter, FilterState, Method


@runtime_checkable
class Width(Protocol):
    """How wide a particle is before its step."""

    def before(self, particle: Float[Array, " d"], belief: Belief, /) -> Belief: ...


@dataclass(frozen=True)
class Carried:
    """As its filter has left it."""

    def before(self, particle: Float[Array, " d"], belief: Belief) -> Belief:
        return belief._replace(mean=particle)


@dataclass(frozen=True)
class Guided:
    """Not at all."""

    def before(self, particle: Float[Array, " d"], belief: Belief) -> Belief:
        return jax.tree.map(jnp.zeros_like, belief)._replace(mean=particle)


@dataclass(frozen=True)
class GaussianProposal:
    """The posterior of a Gaussian filter for each particle; made by `carried` and `guided`."""

    method: Method
    width: Width
    process_noise: Covariance | None = None
    observation_noise: Covariance | None = None

    def fits(self, model: StateSpaceModel) -> None:
        require_densities(model, "a proposal that looks at the measurement")
        self.method.fits(self._own(model))

    def ready(self, model: StateSpaceModel) -> Filter:
        return Filter.of(self._own(model), self.method)

    def start(self, tools: Filter, count: int) -> FilterState:
        state = tools.init()
        return jax.tree.map(lambda a: jnp.broadcast_to(a, (count, *a.shape)), state)

    def ahead(self, tools: Filter, state: ParticleState, u: Any) -> FilterState:
        def one(particle: Array, before: FilterState) -> FilterState:
            return tools.predict(tools.about(self.width.before(particle, before.belief), before.step), u)

        return of_each(one, state.particles, state.origin.proposal)

    def prospect(self, tools: Filter, at: Instant, state: ParticleState) -> Prospect:
        given, info = of_each(lambda before: tools.update(before, at.y, at.u), state.origin.proposal)
        return Prospect(given, info.log_likelihood)

    def draw(self, at: Instant, key: Array, state: ParticleState, prospect: Prospect) -> Drawn:
        def anew() -> Drawn:
            space, belief = at.functions.state_space, prospect.given.belief
            noise = normals(key, belief.factor.shape[:2], belief.mean.dtype)
            steps = jnp.sum(belief.factor * noise[:, None, :], axis=2)
            particles = jax.vmap(space.retract)(belief.mean, steps)
            heights = jnp.sum(jnp.log(jnp.abs(jnp.diagonal(belief.factor, axis1=1, axis2=2))), axis=1)
            log_q = -0.5 * jnp.sum(noise**2, axis=1) - heights - noise.shape[1] * LOG_2PI / 2
            log_q = log_q - stretched(space, belief.mean, steps, state.origin.centre)
            log_p = at.log_likelihood(particles) + at.log_prior(particles, state.origin.centre)
            return Drawn(particles, log_p - log_q, prospect.given)

        return where_usable(at, state, anew)

    def afresh(self) -> "GaussianProposal":
        return self

    def _own(self, model: StateSpaceModel) -> StateSpaceModel:
        """The model with the covariances that the proposal takes its noises to have."""
        for name in ("process_noise", "observation_noise"):
            cov = getattr(self, name)
            if cov is not None:
                own = with_covariance(name, getattr(model, name), cov)
                model = eqx.tree_at(lambda m, name=name: getattr(m, name), model, own)
        return model


def stretched(
    space: Space, mean: Float[Array, "N d"], steps: Float[Array, "N n"], centre: Float[Array, "N d"]
) -> Float[Array, " N"]:
    """Logarithm of how a step from `mean` is stretched as seen from `centre`: densities are of differences from there.

    Nothing where differences are those of vectors or angles.
    """
    if same_elements(space):
        return jnp.zeros(mean.shape[0], mean.dtype)

    def one(mean: Array, step: Array, centre: Array) -> Array:
        J = jax.jacfwd(lambda d: space.residual(space.retract(mean, d), centre))(step)
        return jnp.linalg.slogdet(J)[1]

    return jax.vmap(one)(mean, steps, centre)


def _covariance(name: str, given: Any) -> Covariance | None:
    return None if given is None else covariance(name, given)


def carried(method: Method, *, process_noise: Any = None, observation_noise: Any = None) -> GaussianProposal:
    """A Gaussian filter for every particle, whose covariance is carried along with it, as in the papers.

    Args:
        method: the filter, e.g. `ekf()`, `srukf()`.
        process_noise: covariance (n, n) that the proposal takes the process noise to have; the model's if not given.
        observation_noise: likewise (m, m).

    Raises:
        ValueError: not a Gaussian filter; a covariance that is none.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> wide = sp.proposals.carried(sp.srcdkf(), observation_noise=10 * jnp.eye(1))
        >>> sp.particle_filter(200, proposal=wide).particles
        200
    """
    method = gaussian_filter("method", method)
    noises = _covariance("process_noise", process_noise), _covariance("observation_noise", observation_noise)
    return GaussianProposal(method, Carried(), *noises)


def guided(method: Method, *, process_noise: Any = None, observation_noise: Any = None) -> GaussianProposal:
    """The locally optimal proposal p(x[k] | x[k−1], y[k]), as a Gaussian filter finds it from the particle alone.

    Exact, and of the least variance, where the process noise is Gaussian and measurements are linear in the state.

    Args:
        method: the filter, e.g. `ekf()`, `srukf()`.
        process_noise: as for `carried`.
        observation_noise: as for `carried`.

    Raises:
        ValueError: as `carried`.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.particle_filter(200, proposal=sp.proposals.guided(sp.ekf())).proposal.width
        Guided()
    """
    return GaussianProposal(
        carried(method).method,
        Guided(),
        _covariance("process_noise", process_noise),
        _covariance("observation_noise", observation_noise),
    )
