"""Third-degree spherical-radial cubature rule, the CKF's.

Source: Arasaratnam & Haykin (2009). 2n points at ± √n with equal weights: the unscented rule with α = 1, β = κ = 0. The
centre is evaluated too, with weight zero, because differences are taken from it (which keeps angles apart correctly).
"""

from dataclasses import dataclass

from sigmapoint.rules.linearization import SigmaPointRule
from sigmapoint.rules.point_sets import PointSet
from sigmapoint.rules.unscented import Unscented


@dataclass(frozen=True)
class Cubature(SigmaPointRule):
    """2n equally weighted points."""

    def sigma_points(self, n: int) -> PointSet:
        return Unscented(1.0, 0.0, 0.0).sigma_points(n)
