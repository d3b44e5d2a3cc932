"""Another rule's points, with everything taken about the value at the mean: option 2 of parameter estimation.

Source: Wan & van der Merwe, "The Unscented Kalman Filter" (2001), Table 7.4.1: d̂ = G(x, ŵ), and with it the covariance
Σ Wᵢ (Dᵢ − d̂)(Dᵢ − d̂)ᵀ, to which the centre adds nothing. (Sets that are not symmetric keep theirs about the mean.)
"""

from dataclasses import dataclass

from jaxtyping import Array, Float

from sigmapoint.rules.linearization import Linearization, SigmaPointRule
from sigmapoint.rules.point_sets import PointSet, SymmetricPoints
from sigmapoint.spaces import Space


@dataclass(frozen=True)
class AtMean(SigmaPointRule):
    """`rule`, about the value at the mean."""

    rule: SigmaPointRule

    def sigma_points(self, n: int) -> PointSet:
        points = self.rule.sigma_points(n)
        return points._replace(mixed=0.0) if isinstance(points, SymmetricPoints) else points

    def combine(self, values: Float[Array, "p d"], n: int, space: Space) -> Linearization:
        return super().combine(values, n, space)._replace(mean=values[0])
