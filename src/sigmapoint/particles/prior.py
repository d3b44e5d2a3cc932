"""The prior as a proposal: particles drawn from the model itself, p(x[k] | x[k−1]), blind to the measurement.

Source: Gordon, Salmond & Smith (1993); Wan & van der Merwe (2001), equation 7.107. The ratio is the likelihood.
"""

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from sigmapoint.methods import srukf
from sigmapoint.model import StateSpaceModel
from sigmapoint.particles.gaussian import GaussianProposal, Guided
from sigmapoint.particles.instant import Instant
from sigmapoint.particles.proposal import Drawn, Proposal, Prospect, as_they_are, where_usable
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

    def afresh(self) -> Proposal:
        return FreshPrior()


@dataclass(frozen=True)
class FreshPrior:
    """Particles drawn when the measurement is there, and its density in the `outlook` of a Gaussian filter.

    The likelihood at the predicted state (Pitt & Shephard 1999) would be narrower than what becomes of it: the weights
    then have an infinite variance (Johansen & Doucet 2008).
    """

    outlook: GaussianProposal = GaussianProposal(srukf(), Guided())  # noqa: RUF009 (frozen)

    def fits(self, model: StateSpaceModel) -> None:
        model.process_noise.added("process_noise", "sp.auxiliary(sp.bootstrap(...))", "use sp.bootstrap(...) as it is")
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
            particles = at.from_prior(key, state.origin.centre)
            return Drawn(particles, at.log_likelihood(particles), prospect.given)

        return where_usable(at, state, anew)

    def afresh(self) -> Proposal:
        return self


def prior() -> Prior:
    """The model itself: particles are drawn ahead, blind to the measurement to come.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.particle_filter(100, proposal=sp.proposals.prior()) == sp.bootstrap(100)
        True
    """
    return Prior()
