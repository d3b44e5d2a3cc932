"""Third-degree spherical simplex-radial cubature rule: a regular simplex and its mirror image, √n from the centre.

Source: Wang, Feng & Tse (2014). Exact for polynomials to third degree in any dimension, as `Cubature` is, whose points
lie on the axes, where ξᵢξⱼ is zero, and lose its variance; these see some of it, unequally for different pairs.
"""

from dataclasses import dataclass

import numpy as np

from sigmapoint.rules.linearization import SigmaPointRule
from sigmapoint.rules.point_sets import PointSet, from_weights
from sigmapoint.rules.simplex import simplex_vertices


@dataclass(frozen=True)
class SphericalSimplex(SigmaPointRule):
    """2(n+1) equally weighted points."""

    def sigma_points(self, n: int) -> PointSet:
        vertices = np.sqrt(n + 1) * simplex_vertices(n)
        weights = np.append(0.0, np.full(2 * (n + 1), 0.5 / (n + 1)))
        return from_weights(np.concatenate([np.zeros((1, n)), vertices, -vertices]), weights)
