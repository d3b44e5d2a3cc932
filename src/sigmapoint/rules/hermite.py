"""Gauss-Hermite product rule of any order.

Source: Ito & Xiong (2000), "Gaussian filters for nonlinear filtering problems". The p-point rule in one dimension is
exact for polynomials to degree 2p−1; its tensor product has pⁿ points, so it is for small n.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from sigmapoint import checks
from sigmapoint.rules.linearization import SigmaPointRule
from sigmapoint.rules.point_sets import PointSet, from_weights

MOST_POINTS = 5_000


@dataclass(frozen=True)
class GaussHermite(SigmaPointRule):
    """The tensor product of `order`-point Gauss-Hermite rules; `order` at least 2."""

    order: int

    def __post_init__(self) -> None:
        checks.whole("order", self.order, 2)

    def sigma_points(self, n: int) -> PointSet:
        if self.order**n > MOST_POINTS:
            raise ValueError(
                f"Gauss-Hermite of order {self.order} in {n} dimensions has {self.order}**{n} points, more than "
                f"{MOST_POINTS}; lower the order, or use sp.srcdkf(), sp.ukf() or sp.ckf(), whose points grow with n"
            )
        nodes, weights = np.polynomial.hermite_e.hermegauss(self.order)
        weights = weights / weights.sum()
        points = np.array(list(product(nodes, repeat=n))).reshape(-1, n)
        each = np.array([np.prod(c) for c in product(weights, repeat=n)])
        centre = np.all(np.abs(points) < 1e-12, axis=1)
        points, outer = points[~centre], each[~centre]
        points = np.concatenate([np.zeros((1, n)), points])
        return from_weights(points, np.concatenate([[1 - outer.sum()], outer]))
