"""The result of a particle filter."""

from typing import ClassVar

import numpy as np
from jaxtyping import Array, Float, Int

from sigmapoint.breakdown import of_series
from sigmapoint.checks import known
from sigmapoint.particles.gaussian_sum.mixture import Mixture
from sigmapoint.results import FIELDS, Posterior


class ParticlePosterior(Posterior):
    """Beliefs over a series as weighted particles: a `Posterior` of their moments, and what stands behind it.

    Attributes:
        ess: effective sample size (T,) after weighing; 0 where no particle explained the measurement: there all weights
            were zero and stay as predicted, and `log_likelihood` is minus infinity.
        particles: (T, N, n), if kept.
        log_weights: (T, N), if kept; those of an instant sum to one.
        ancestors: for each particle, its place among those of the row before (T, N), if kept; after `fixed_lag`, the
            place in its own row of what became of it.
        log_likelihood: natural logarithm of an unbiased estimate of the density of all measurements ().
    """

    FIELDS: ClassVar[tuple[str, ...]] = (*FIELDS, "particles", "log_weights", "ancestors")
    ALWAYS: ClassVar[tuple[str, ...]] = ("ess",)
    AXES: ClassVar[dict[str, tuple[str, ...]]] = {
        "ess": ("time",),
        "particles": ("time", "particle", "state"),
        "log_weights": ("time", "particle"),
        "ancestors": ("time", "particle"),
    }

    ess: Float[Array, "*B T"] | None
    particles: Float[Array, "*B T N d"] | None
    log_weights: Float[Array, "*B T N"] | None
    ancestors: Int[Array, "*B T N"] | None = None

    def breakdown(self, series: int | None = None) -> str | None:
        """What a warning says where all particles were lost; else that of a `Posterior`."""
        if self.ess is None or not known(self.ess) or not np.any(none := np.asarray(self.ess) == 0):
            return super().breakdown(series)
        row, which = np.argwhere(none)[0][-1], of_series(none.any(-1), series)
        return (
            f"no particle explains the measurement of row {row}{which}: all weights were zero there, so the particles "
            "stay as predicted, and the log-likelihood is minus infinity. Is the model's value there a number? Use "
            "more particles, a proposal that looks at the measurement (sp.proposals.guided), or a noise with heavier "
            "tails"
        )


class GaussianSumPosterior(ParticlePosterior):
    """Moments of mixtures of Gaussians over a series, and the weighted particles that these were found in.

    Attributes:
        mixture: the beliefs themselves, if kept: `log_weights` (T, G), `mean` (T, G, d) and `factor` (T, G, n, n) of
            their components.
        mean, cov, std: of the mixtures.
        ess, particles, log_weights: as of a `ParticlePosterior`; particles have no ancestors.
        log_likelihood: natural logarithm of an estimate of the density of all measurements (), consistent, but not
            unbiased, as the mixtures are found in samples.
    """

    FIELDS: ClassVar[tuple[str, ...]] = (*FIELDS, "particles", "log_weights", "mixture")
    AXES: ClassVar[dict[str, tuple[str, ...]]] = ParticlePosterior.AXES | {
        "mixture.log_weights": ("time", "component"),
        "mixture.mean": ("time", "component", "state"),
        "mixture.cov": ("time", "component", "state", "state2"),
    }

    mixture: Mixture | None = None
