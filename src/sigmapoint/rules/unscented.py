"""Scaled unscented transform, and Julier's set with a free centre weight.

Source: Wan & van der Merwe (2001), eqs 7.30-7.34; Julier & Uhlmann (1997) for the unscaled set. With
λ = α²(n+κ) − n the points are `± √(n+λ)` along each axis, wᵢ = 1/(2(n+λ)), W₀⁽ᵐ⁾ = λ/(n+λ) and
W₀⁽ᶜ⁾ = W₀⁽ᵐ⁾ + 1 − α² + β. About the centre value this is Cov = Σ wᵢ dᵢdᵢᵀ + (β − α²) μμᵀ, whatever the sign of W₀.
"""

from dataclasses import dataclass

import numpy as np

from sigmapoint.rules.linearization import SigmaPointRule
from sigmapoint.rules.point_sets import PointSet, SymmetricPoints


@dataclass(frozen=True)
class Unscented(SigmaPointRule):
    """2n+1 points with scaling parameters α (spread), β (prior kurtosis; 2 for Gaussian), κ (secondary spread)."""

    alpha: float
    beta: float
    kappa: float

    def __post_init__(self) -> None:
        if not self.alpha > 0:
            raise ValueError(f"alpha must be positive, got {self.alpha}")
        if not np.isfinite([self.alpha, self.beta, self.kappa]).all():
            raise ValueError(f"alpha, beta and kappa must be finite, got {self.alpha}, {self.beta}, {self.kappa}")
        if self.kappa == 0:  # then the condition does not depend on the dimension, and is checked at once
            self.sigma_points(1)

    def sigma_points(self, n: int) -> PointSet:
        if not n + self.kappa > 0:
            raise ValueError(f"kappa must be greater than -n; got kappa={self.kappa} in n={n} dimensions")
        spread2 = self.alpha**2 * (n + self.kappa)
        # Along Σ(D₊+D₋) the covariance is scaled by c² = 1 + (β − α²) s, s = Σ wᵢ: see `from_weights`.
        c2 = 1 + (self.beta - self.alpha**2) * n / spread2
        if c2 < -1e-12:
            raise ValueError(
                f"alpha={self.alpha}, beta={self.beta}, kappa={self.kappa} give a covariance that is not positive "
                f"semi-definite in n={n} dimensions; beta >= alpha**2 (e.g. beta=2) works, and so does a larger kappa"
            )
        return SymmetricPoints(n, float(np.sqrt(spread2)), 1.0, float(np.sqrt(max(c2, 0.0)) - 1) / n)


@dataclass(frozen=True)
class Julier(SigmaPointRule):
    """2n+1 points with centre weight 0 ≤ W₀ < 1 and the covariance taken about the mean, all with the same weights."""

    w0: float

    def __post_init__(self) -> None:
        if not 0 <= self.w0 < 1:
            raise ValueError(
                f"w0, the weight of the centre point, must be in [0, 1), got {self.w0}; a negative one can break the "
                "covariance; sp.ukf(alpha=1, beta=2, kappa=w0 * n / (1 - w0)) has the same points and cannot"
            )

    def sigma_points(self, n: int) -> PointSet:
        return Unscented(1.0, 0.0, n * self.w0 / (1 - self.w0)).sigma_points(n)
