"""Samples of a posterior over parameters, in their own units, and whether they can be trusted."""

import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.contents import Card, Contents
from sigmapoint.diagnosis.verdict import Verdict
from sigmapoint.filtering import fitting
from sigmapoint.identification.contents import at_one_time
from sigmapoint.identification.estimates import BAR, Estimates
from sigmapoint.identification.likelihood import LogPosterior, posterior_of
from sigmapoint.identification.unknowns import Unknowns, built
from sigmapoint.model import StateSpaceModel
from sigmapoint.printing import aligned
from sigmapoint.recipe import Recipe

AGREE = 1.1
"""R̂ up to which chains agree."""


def to_sample(
    what: str, build: Callable[[Any], StateSpaceModel], theta: Any, y: Any, u: Any, method: Recipe
) -> LogPosterior:
    """What `pmmh` and `smc2` sample, with what they need.

    Raises:
        ImportError: blackjax is not installed.
        ValueError: as `log_posterior`; nothing measured; under a transformation of JAX.
    """
    checks.extra("blackjax", what, "mcmc")
    checks.untransformed(what, "sp.log_posterior", theta, y, u)
    posterior = posterior_of(build, theta, y, u, method, fitting)
    if not posterior.measured:
        raise ValueError("y has no measurements: every element is NaN")
    return posterior


class PosteriorSamples(eqx.Module):
    """Samples of the posterior of a model's parameters; made by `pmmh` and `smc2`. `print` of it is a table."""

    posterior: LogPosterior
    """the density that they are from"""
    z: Float[Array, "C M L"]
    """the samples, all of one weight: of every chain (one for `smc2`), without bounds"""
    log_likelihood: Float[Array, "C M"]
    """natural logarithm of the density of all measurements, as it was estimated for each sample"""
    acceptance_rate: float
    """share of the proposed parameters that were accepted (for `smc2`, in its last moves)"""
    ess: Float[np.ndarray, " L"]
    """effective sample size of each parameter (for `smc2`, of the weights before the last moves)"""
    r_hat: Float[np.ndarray, " L"]
    """rank-normalised R̂: 1 where the chains agree; NaN for `smc2`"""
    log_evidence: float
    """natural logarithm of the density of all measurements under the prior; NaN for `pmmh`, which does not say"""

    @property
    def samples(self) -> Any:
        """The samples as a pytree like the parameters, in their own units, with leading axes (chains, samples)."""
        unknowns, lead = self.posterior.unknowns, self.z.shape[:2]
        found = jax.vmap(unknowns.tree.only)(self.z.reshape(-1, unknowns.size))
        return unknowns.tree.complete(jax.tree.map(lambda a: a.reshape(*lead, *a.shape[1:]), found))

    @property
    def estimates(self) -> Estimates:
        """Median, half the width of the central 68 %, and the central 95 %, each a pytree like the parameters."""
        return self._estimates(self.posterior.unknowns)

    @property
    def theta(self) -> Any:
        """The median of each parameter, as the pytree that `build` takes."""
        return self.posterior.theta(self._quantile(0.0))

    @property
    def model(self) -> StateSpaceModel:
        """The model with these parameters."""
        return built(self.posterior.build, self.theta)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the unknown parameters, in the order of `z`."""
        return self.posterior.unknowns.names

    def contents(self) -> Contents:
        """What a page about it shows: the table of the parameters, and how well they were sampled."""
        C, M, _ = self.z.shape
        cards = (
            Card("Effective samples", float(self.ess.min()), f"the fewest of a parameter, of {C * M}"),
            Card("Accepted", self.acceptance_rate),
            *(() if np.isnan(self.log_evidence) else (Card("Log-evidence", self.log_evidence),)),
        )
        bad = Verdict("bad", f"The chains do not agree (R̂ up to {self.r_hat.max():.3g}): give more samples.")
        table = at_one_time(self.names, self.estimates)
        return Contents({}, (table._replace(cards=cards, verdicts=() if self.agree else (bad,)),))

    @property
    def agree(self) -> bool:
        """Whether the chains do: every R̂ is at most 1.1, or there is none."""
        return not (self.r_hat > AGREE).any()

    def _estimates(self, unknowns: Unknowns) -> Estimates:
        low, below, median, above, high = map(self._quantile, (-BAR, -1.0, 0.0, 1.0, BAR))
        half = jax.tree.map(lambda a, b: (a - b) / 2, unknowns.tree.only(above), unknowns.tree.only(below))
        return Estimates(unknowns.tree(median), unknowns.tree.complete(half), unknowns.tree(low), unknowns.tree(high))

    def _quantile(self, deviations: float) -> Float[Array, " L"]:
        """Of z, with as much of it below as a Gaussian has below so many of its deviations."""
        share = (1 + math.erf(deviations / math.sqrt(2))) / 2
        return jnp.quantile(self.z.reshape(-1, self.z.shape[-1]), share, axis=0)

    def __str__(self) -> str:
        found = self._estimates(self.posterior.unknowns.flat)
        compared = not np.isnan(self.r_hat).all()
        rows = [("", "median", "std", "95 % interval", "ess", *(("R̂",) if compared else ()))]
        for i, name in enumerate(self.names):
            value, spread, low, high = (f"{float(a[i]):.4g}" for a in (found.value, found.std, found.low, found.high))
            agree = (f"{self.r_hat[i]:.3f}",) if compared else ()
            rows.append((name, value, spread, f"{low} … {high}", f"{self.ess[i]:.0f}", *agree))
        evidence = "" if np.isnan(self.log_evidence) else f", log-evidence {self.log_evidence:.6g}"
        C, M, _ = self.z.shape
        return "\n".join([*aligned(rows), f"{C} × {M} samples, {self.acceptance_rate:.0%} accepted{evidence}"])
