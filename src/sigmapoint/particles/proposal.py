"""Proposals: what the particles of an instant are drawn from, q(x[k] | x[k−1], y[k]).

A particle drawn from q has its weight multiplied by

    p(y[k] | x[k]) p(x[k] | x[k−1]) / q(x[k] | x[k−1], y[k])

(Wan & van der Merwe 2001, equation 7.102). Time passes before a measurement comes, so every particle is first drawn
from the model; a proposal that looks at the measurement replaces these draws, from the same origin. Where nothing was
measured, or the origin has served before (a second measurement at one instant), they stay.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import numpy as np
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.densities import finite_part
from sigmapoint.entering import NoiseSeries
from sigmapoint.model import StateSpaceModel
from sigmapoint.noise import Additive
from sigmapoint.particles.instant import Instant
from sigmapoint.particles.state import ParticleState

INSTEAD = "use sp.bootstrap(...), which only draws it"
Covariance = tuple[tuple[float, ...], ...]


class Prospect(NamedTuple):
    """What a measurement makes of the origin of every particle, before any is drawn."""

    given: Any
    """what to draw from"""
    log_density: Float[Array, " N"]
    """logarithm of about what density the measurement has from there"""


class Drawn(NamedTuple):
    """Particles, the logarithm of the ratio that multiplies their weights, and what the proposal remembers of them."""

    particles: Float[Array, "N d"]
    log_ratio: Float[Array, " N"]
    memory: Any


@runtime_checkable
class Proposal(Protocol):
    """What particles are drawn from. Hashable."""

    def fits(self, model: StateSpaceModel, /) -> None:
        """Raise where the model has no density that is needed."""
        ...

    def ready(self, model: StateSpaceModel, /) -> Any:
        """What is computed once for a run, handed to the others as `tools`."""
        ...

    def start(self, tools: Any, count: int, /) -> Any:
        """What is remembered of particles at instant 0."""
        ...

    def ahead(self, tools: Any, state: ParticleState, u: Any, /) -> Any:
        """What is remembered of particles that have gone on to the next instant."""
        ...

    def prospect(self, tools: Any, at: Instant, state: ParticleState, /) -> Prospect:
        """What a measurement makes of their origins."""
        ...

    def draw(self, at: Instant, key: Array, state: ParticleState, prospect: Prospect, /) -> Drawn:
        """Particles of this instant."""
        ...

    def afresh(self) -> "Proposal":
        """The same, drawing anew when a measurement comes: copies of one origin must not be copies of one draw."""
        ...


@dataclass(frozen=True)
class Prior:
    """The model itself, blind to the measurement: p(x[k] | x[k−1]) (equation 7.107). The ratio is the likelihood."""

    def fits(self, model: StateSpaceModel) -> None:
        pass

    def ready(self, model: StateSpaceModel) -> None:
        pass

    def start(self, tools: None, count: int) -> None:
        pass

    def ahead(self, tools: None, state: ParticleState, u: Any) -> None:
        pass

    def prospect(self, tools: None, at: Instant, state: ParticleState) -> Prospect:
        return Prospect(None, at.log_likelihood(state.origin.centre))

    def draw(self, at: Instant, key: Array, state: ParticleState, prospect: Prospect) -> Drawn:
        return as_they_are(at, state)

    def afresh(self) -> Proposal:
        return FreshPrior()


@dataclass(frozen=True)
class FreshPrior(Prior):
    """The same, drawn when the measurement is there."""

    def fits(self, model: StateSpaceModel) -> None:
        model.process_noise.added("process_noise", "sp.auxiliary(sp.bootstrap(...))", "use sp.bootstrap(...) as it is")

    def draw(self, at: Instant, key: Array, state: ParticleState, prospect: Prospect) -> Drawn:
        def anew() -> Drawn:
            particles = at.from_prior(key, state.origin.centre)
            return Drawn(particles, at.log_likelihood(particles), state.origin.proposal)

        return where_usable(at, state, anew)

    def afresh(self) -> Proposal:
        return self


@dataclass(frozen=True)
class GaussianPrior(Prior):
    """The model with a Gaussian process noise of its own, blind to the measurement; made by `prior`."""

    process_noise: Covariance

    def fits(self, model: StateSpaceModel) -> None:
        dense(model, "a proposal with a noise of its own")
        self._noise(model)

    def draw(self, at: Instant, key: Array, state: ParticleState, prospect: Prospect) -> Drawn:
        def anew() -> Drawn:
            centre, system = state.origin.centre, at.system
            process = NoiseSeries.of(self._noise(system.model), centre.dtype)
            own = at._replace(system=system._replace(process=process))
            particles = own.from_prior(key, centre)
            log_p = at.log_likelihood(particles) + at.log_prior(particles, centre)
            return Drawn(particles, log_p - own.log_prior(particles, centre), state.origin.proposal)

        return where_usable(at, state, anew)

    def afresh(self) -> Proposal:
        return self

    def _noise(self, model: StateSpaceModel) -> Additive:
        return with_covariance("process_noise", model.process_noise, self.process_noise)


def prior(*, process_noise: Any = None) -> Prior:
    """The model itself: particles are drawn ahead, blind to the measurement to come.

    Args:
        process_noise: covariance (n, n) of a Gaussian that particles are drawn from in place of the process noise, with
            its mean, their weights making up for it: wider, for a tail that few draws would reach, or where the noise
            has a density but cannot be drawn well. The process noise itself if not given.

    Raises:
        ValueError: a covariance that is none.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> sp.particle_filter(100, proposal=sp.proposals.prior()) == sp.bootstrap(100)
        True
        >>> sp.particle_filter(100, proposal=sp.proposals.prior(process_noise=4 * jnp.eye(1))).proposal
        GaussianPrior(process_noise=((4.0,),))
    """
    return Prior() if process_noise is None else GaussianPrior(covariance("process_noise", process_noise))


def covariance(name: str, given: Any) -> Covariance:
    """As numbers that can be compared and hashed."""
    cov = checks.array(name, given)
    checks.covariance(name, cov)
    return tuple(tuple(row) for row in np.asarray(cov, float).tolist())


def with_covariance(name: str, noise: Any, cov: Covariance) -> Additive:
    """A Gaussian of this covariance with the mean of another noise, zero where that has none."""
    own = Additive(np.asarray(cov))
    own.fits(f"{name} of the proposal", noise.mean.shape[-1], "noise")
    return Additive(own.cov, finite_part(noise.mean, 0.0))


def dense(model: StateSpaceModel, by: str) -> None:
    """Raise where what the particles come from has no density."""
    for name, noise in (("process_noise", model.process_noise), ("initial", Additive(model.initial))):
        noise.dense(name, by, INSTEAD)


def as_they_are(at: Instant, state: ParticleState) -> Drawn:
    """The particles that there are, weighed by the likelihood."""
    return Drawn(state.particles, at.log_likelihood(state.particles), state.origin.proposal)


def where_usable(at: Instant, state: ParticleState, anew: Callable[[], Drawn]) -> Drawn:
    """New draws where the measurement and the origin can be used for it."""
    return jax.lax.cond(at.usable(state), anew, lambda: as_they_are(at, state))
