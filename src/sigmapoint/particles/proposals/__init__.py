"""Proposals by name: `prior`, `carried` and `guided`."""

from sigmapoint.particles.proposals.gaussian import carried, guided
from sigmapoint.particles.proposals.transition import prior

__all__ = ["carried", "guided", "prior"]
