"""Proposals by name: `prior`, `carried` and `guided`."""

from sigmapoint.particles.gaussian import carried, guided
from sigmapoint.particles.prior import prior

__all__ = ["carried", "guided", "prior"]
