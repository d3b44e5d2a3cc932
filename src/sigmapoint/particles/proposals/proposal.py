"""Proposals: what the particles of an instant are drawn from, q(x[k] | x[k−1], y[k]).

A particle drawn from q has its weight multiplied by

    p(y[k] | x[k]) p(x[k] | x[k−1]) / q(x[k] | x[k−1], y[k])

(Wan & van der Merwe 2001, equation 7.102). Time passes before a measurement comes, so every particle is first drawn
from the model; a proposal that looks at the measurement replaces these draws, from the same origin. Where nothing was
measured, or the origin has served before (a second measurement at one instant), they stay.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import numpy as np
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.checks import belief_checks
from sigmapoint.densities import finite_part
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


def covariance(name: str, given: Any) -> Covariance:
    """As numbers that can be compared and hashed."""
    cov = checks.array(name, given)
    belief_checks.covariance(name, cov)
    return tuple(tuple(row) for row in np.asarray(cov, float).tolist())


def with_covariance(name: str, noise: Any, cov: Covariance) -> Additive:
    """A Gaussian of this covariance with the mean of another noise, zero where that has none."""
    own = Additive(np.asarray(cov))
    own.fits(f"{name} of the proposal", noise.mean.shape[-1], "noise")
    return Additive(own.cov, finite_part(noise.mean, 0.0))


def require_densities(model: StateSpaceModel, by: str, instead: str = INSTEAD) -> None:
    """Raise where what the particles come from has no density."""
    for name, noise in (("process_noise", model.process_noise), ("initial", Additive(model.initial))):
        noise.require_density(name, by, instead)


def as_they_are(at: Instant, state: ParticleState) -> Drawn:
    """The particles that there are, weighed by the likelihood."""
    return Drawn(state.particles, at.log_likelihood(state.particles), state.origin.proposal)


def where_usable(at: Instant, state: ParticleState, anew: Callable[[], Drawn]) -> Drawn:
    """New draws where the measurement and the origin can be used for it."""
    return jax.lax.cond(at.usable(state), anew, lambda: as_they_are(at, state))
