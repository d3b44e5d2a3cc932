"""Central difference rule (Stirling interpolation), the CDKF's.

Source: Nørgaard, Poulsen & Ravn (2000); Ito & Xiong (2000); Wan & van der Merwe (2001), section 7.3. With interval h:
ȳ = (h²−n)/h² Y₀ + Σ (Y₊+Y₋)/(2h²), Φ = (Y₊−Y₋)/(2h), E = √(h²−1)/(2h²) (Y₊+Y₋−2Y₀). Always positive semi-definite;
h² = 3 matches the fourth moment of a Gaussian.
"""

from dataclasses import dataclass

import numpy as np

from sigmapoint.rules.linearization import SigmaPointRule
from sigmapoint.rules.point_sets import PointSet, SymmetricPoints


@dataclass(frozen=True)
class CentralDifference(SigmaPointRule):
    """2n+1 points at ± h standard deviations along each column of the factor."""

    h: float

    def __post_init__(self) -> None:
        if not (self.h >= 1 and np.isfinite(self.h)):
            raise ValueError(
                f"h, the central difference interval, must be at least 1 (sqrt(3) is optimal), got {self.h}"
            )

    def sigma_points(self, n: int) -> PointSet:
        return SymmetricPoints(n, self.h, float(np.sqrt(self.h**2 - 1)) / self.h, 0.0)
