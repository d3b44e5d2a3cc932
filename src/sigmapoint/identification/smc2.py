"""SMC²: a population of parameters, each with a particle filter of its own, that follows the measurements in time.

Source: Chopin, Jacob & Papaspiliopoulos, "SMC²: an efficient algorithm for sequential analysis of state space models",
J. R. Stat. Soc. B 75 (2013) 397.
"""

import warnings
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from sigmapoint import checks
from sigmapoint.blackbox import unwrapped
from sigmapoint.identification.likelihood import LogPosterior
from sigmapoint.identification.posterior_samples import PosteriorSamples, to_sample
from sigmapoint.model import StateSpaceModel
from sigmapoint.particles.method import bootstrap
from sigmapoint.recipe import Recipe

STUCK = 0.1
"""Share of moves accepted, below which a population hardly moves."""


def smc2(
    build: Callable[[Any], StateSpaceModel],
    theta: Any,
    y: Any,
    u: Any = None,
    *,
    key: Array | int,
    method: Recipe | None = None,
    samples: int = 200,
    steps: int = 3,
) -> PosteriorSamples:
    """Sample the posterior of a model's parameters, and compute the evidence of the model, by particles of particles.

    It starts with draws of the prior, which may be wide and lead to several modes, where a chain of `pmmh` would find
    one; the difference of two models' `log_evidence` is the logarithm of their Bayes factor.

    Args:
        build: `build(theta) -> StateSpaceModel`, as for `pmmh`.
        theta: the parameters and what is known of them, as for `pmmh`. This is the prior.
        y: measurements (T, m), NaN where an element was not measured; or a list of independent series (Tᵢ, m), whose
            rows k are taken in together.
        u: inputs, as for `filter`; for a list, a list of them.
        key: `jax.random.key(seed)`, or the seed.
        method: as for `filter`; `sp.bootstrap(500)` where not given. A Gaussian filter makes it sequential Monte Carlo
            over parameters with the likelihood that this filter sees (IBIS, Chopin 2002).
        samples: parameters in the population.
        steps: of Metropolis–Hastings for each, whenever half of the population's effective size is lost, and at
            the end. Each takes a run of the filter over all measurements so far.

    Returns:
        `PosteriorSamples` with one chain of `samples`, and `log_evidence`.

    Raises:
        ValueError: as `log_posterior`; nothing measured; a row of `y` that no parameter explains; under `jax.jit`.
        ImportError: blackjax is not installed (`pip install sigmapoint[mcmc]`).

    Warns where fewer than a tenth of the last moves were accepted.

    Source: Chopin, Jacob & Papaspiliopoulos (2013), section 3.1.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> def build(theta):
        ...     return sp.StateSpaceModel(lambda x, u: theta["a"] * x, lambda x, u: x, 0.5 * jnp.eye(1),
        ...                               0.5 * jnp.eye(1), sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> _, y = sp.simulate(build({"a": 0.8}), 30, key=1)
        >>> theta = {"a": sp.bounded(0.5, 0.3, -1.0, 1.0)}
        >>> found = sp.smc2(build, theta, y, key=1, method=sp.bootstrap(50), samples=100)
        >>> found.samples["a"].shape, bool(found.estimates.low["a"] < 0.8 < found.estimates.high["a"])
        ((1, 100), True)
    """
    posterior = to_sample("smc2", build, theta, y, u, bootstrap(500) if method is None else method)
    key, samples = checks.key("key", key), checks.whole("samples", samples, 2)
    steps = checks.whole("steps", steps, 1)
    found = _followed(posterior, key, samples, steps)
    if found.acceptance_rate < STUCK:
        warnings.warn(
            f"smc2: {found.acceptance_rate:.0%} of the last moves were accepted, so that few of the samples differ: "
            "give the method more particles, or a better proposal, as sp.proposals.guided(sp.ekf())",
            stacklevel=2,
        )
    return found


def _followed(posterior: LogPosterior, key: Array, samples: int, steps: int) -> PosteriorSamples:
    """The population after all measurements."""
    from sigmapoint.identification.population import advanced, drawn, rejuvenated

    start, run, move = jax.random.split(key, 3)
    population = drawn(posterior, posterior.prior_draws(start, samples), jax.random.split(run, samples))
    while True:
        population = unwrapped(advanced, posterior, population)
        if not np.isfinite(float(population.log_evidence)):
            raise ValueError(_unexplained(int(population.row), samples))
        ess, row = float(population.ess), int(population.row)
        random = jax.random.fold_in(move, row)
        population, accepted = unwrapped(rejuvenated, posterior, population, random, jnp.asarray(steps))
        if row == posterior.y.shape[1]:
            break
    size, points = posterior.unknowns.size, population.points
    return PosteriorSamples(
        posterior,
        points.z[None],
        points.log_likelihood[None],
        float(accepted),
        np.full(size, ess),
        np.full(size, np.nan),
        float(population.log_evidence),
    )


def _unexplained(row: int, samples: int) -> str:
    if not row:
        return (
            f"smc2: none of {samples} draws of theta makes a model: is build(theta) one there, with noises that are "
            "covariances?"
        )
    return (
        f"smc2: none of {samples} draws of theta explains row {row - 1} of y, whose likelihood is zero or not finite "
        "for all: give theta closer to what is possible, more samples, or the model more noise"
    )
