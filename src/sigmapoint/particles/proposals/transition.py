"""The prior as a proposal: particles drawn from the model itself, p(x[k] | x[k−1]), blind to the measurement.

Source: Gordon, Salmond & Smith (1993); Wan & van der Merwe (2001), equation 7.107. The ratio is the likelihood.
"""

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from sigmapoint.entering import NoiseSeries
from sigmapoint.methods import srukf
from sigmapoint.model import StateSpaceModel
from sigmapoint.noise import Additive
from sigmapoint.particles.instant import Instant
from sigmapoint.particles.proposals.gaussian import GaussianProposal, Guided
from sigmapoint.particles.proposals.proposal import (
    Covariance,
    Drawn,
    Proposal,
    Prospect,
    as_they_are,
    covariance,
    require_densities,
    where_usable,
    with_covariance,
)
from sigmapoint.particles.state import ParticleState
from sigmapoint.step import Filter, FilterState


@dataclass(frozen=True)
class Prior:
    """Particles as they were drawn when time passed."""

    def fits(self, model: StateSpaceModel) -> None:
        pass

    def ready(self, model: StateSpaceModel) -> Any:
        pass

    def start(self, tools: Any, count: int) -> Any:
        pass

    def ahead(self, tools: Any, state: ParticleState, u: Any) -> Any:
        pass

    def prospect(self, tools: Any, at: Instant, state: ParticleState) -> Prospect:
        return Prospect(None, jnp.zeros_like(state.log_weights))

    def draw(self, at: Instant, key: Array, state: ParticleState, prospect: Prospect) -> Drawn:
        return as_they_are(at, state)

    def redrawn(self, at: Instant, key: Array, centre: Array) -> tuple[Array, Array]:
        """Particles drawn anew from their origins, and the logarithm of their weights' ratio."""
        particles = at.from_prior(key, centre)
        return particles, at.log_likelihood(particles)

    def afresh(self) -> Proposal:
        return FreshPrior(self)


@dataclass(frozen=True)
class GaussianPrior(Prior):
    """The model with a Gaussian process noise of its own, blind to the measurement; made by `prior`."""

    process_noise: Covariance

    def fits(self, model: StateSpaceModel) -> None:
        require_densities(model, "a proposal with a noise of its own")
        self._noise(model)

    def draw(self, at: Instant, key: Array, state: ParticleState, prospect: Prospect) -> Drawn:
        def anew() -> Drawn:
            return Drawn(*self.redrawn(at, key, state.origin.centre), state.origin.proposal)

        return where_usable(at, state, anew)

    def redrawn(self, at: Instant, key: Array, centre: Array) -> tuple[Array, Array]:
        process = NoiseSeries.of(self._noise(at.system.model), centre.dtype)
        own = at._replace(system=at.system._replace(process=process))
        particles = own.from_prior(key, centre)
        log_p = at.log_likelihood(particles) + at.log_prior(particles, centre)
        return particles, log_p - own.log_prior(particles, centre)

    def _noise(self, model: StateSpaceModel) -> Additive:
        return with_covariance("process_noise", model.process_noise, self.process_noise)


@dataclass(frozen=True)
class FreshPrior:
    """Particles drawn when the measurement is there, and its density in the `outlook` of a Gaussian filter.

    The likelihood at the predicted state (Pitt & Shephard 1999) would be narrower than what becomes of it: the weights
    then have an infinite variance (Johansen & Doucet 2008).
    """

    prior: Prior
    outlook: GaussianProposal = GaussianProposal(srukf(), Guided())  # noqa: RUF009 (frozen)

    def fits(self, model: StateSpaceModel) -> None:
        model.process_noise.require_additive(
            "process_noise", "sp.auxiliary(sp.bootstrap(...))", "use sp.bootstrap(...) as it is"
        )
        self.prior.fits(model)
        self.outlook.method.fits(model)

    def ready(self, model: StateSpaceModel) -> Filter:
        return self.outlook.ready(model)

    def start(self, tools: Filter, count: int) -> FilterState:
        return self.outlook.start(tools, count)

    def ahead(self, tools: Filter, state: ParticleState, u: Any) -> FilterState:
        return self.outlook.ahead(tools, state, u)

    def prospect(self, tools: Filter, at: Instant, state: ParticleState) -> Prospect:
        return self.outlook.prospect(tools, at, state)

    def draw(self, at: Instant, key: Array, state: ParticleState, prospect: Prospect) -> Drawn:
        def anew() -> Drawn:
            return Drawn(*self.prior.redrawn(at, key, state.origin.centre), prospect.given)

        return where_usable(at, state, anew)

    def afresh(self) -> Proposal:
        return self


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
