"""Reduced simplex set: n+1 points and the centre, which may have no weight.

Source: Julier (2003), "The spherical simplex unscented transformation"; here the vertices of a regular simplex, at
√(n/(1−W₀)) from the centre, each with weight (1−W₀)/(n+1), and Julier's (2002) scaling by α and β.
"""

from dataclasses import dataclass

import numpy as np

from sigmapoint.rules.linearization import SigmaPointRule
from sigmapoint.rules.point_sets import PointSet, from_weights


@dataclass(frozen=True)
class Simplex(SigmaPointRule):
    """The vertices of a regular simplex (`w0` = 0) and, with `w0` > 0, the centre; scaled by α, β."""

    alpha: float
    beta: float
    w0: float

    def __post_init__(self) -> None:
        if not 0 <= self.w0 < 1:
            raise ValueError(f"w0, the weight of the centre point, must be in [0, 1), got {self.w0}")
        if not self.alpha > 0:
            raise ValueError(f"alpha must be positive, got {self.alpha}")

    def sigma_points(self, n: int) -> PointSet:
        spread2 = (n + 1) / (1 - self.w0)  # the coordinates of `simplex_vertices` have mean square 1 / (n + 1)
        points = np.concatenate([np.zeros((1, n)), self.alpha * np.sqrt(spread2) * simplex_vertices(n)])
        weights = np.full(n + 2, 1 / (spread2 * self.alpha**2))
        weights[0] = 1 - weights[1:].sum()
        return from_weights(points, weights, 1 + self.beta - self.alpha**2)


def simplex_vertices(n: int) -> np.ndarray:
    """n+1 points in n dimensions whose coordinates are orthonormal over the points and orthogonal to the constant."""
    rows = np.zeros((n, n + 1))
    for j in range(n):  # Helmert's contrasts: each compares the next point with all before it
        rows[j, : j + 1] = -1.0
        rows[j, j + 1] = j + 1.0
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).T
