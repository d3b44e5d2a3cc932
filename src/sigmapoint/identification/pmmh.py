"""Particle marginal Metropolis–Hastings: samples of the posterior of parameters, by a filter that only estimates.

Chains start at the best of some draws of the prior, find the length and shape of their steps in the warm-up
(`adaptation`), and go on with these (`pseudo_marginal`).

Source: Andrieu, Doucet & Holenstein, "Particle Markov chain Monte Carlo methods", J. R. Stat. Soc. B 72 (2010) 269.
"""

import warnings
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from sigmapoint import checks
from sigmapoint.identification.posterior_samples import AGREE, PosteriorSamples, to_sample
from sigmapoint.model import StateSpaceModel
from sigmapoint.particles.method import bootstrap
from sigmapoint.recipe import Recipe

NOISY = 3.0
"""Variance of an estimated log-likelihood beyond which chains stick: a deviation of 1 to 1.7 costs the least (Doucet,
Pitt, Deligiannidis & Kohn, Biometrika 102 (2015) 295).
"""


def pmmh(
    build: Callable[[Any], StateSpaceModel],
    theta: Any,
    y: Any,
    u: Any = None,
    *,
    key: Array | int,
    method: Recipe | None = None,
    samples: int = 1000,
    warmup: int = 500,
    chains: int = 4,
) -> PosteriorSamples:
    """Sample the posterior of a model's parameters with particle filters: exact for any number of particles.

    (Where their likelihood is unbiased: that of `gspf`, of `gmsppf` and of a move that depends on the cloud is nearly.)

    No derivatives are needed, so the model may have what a particle filter can: several modes, bounds, any noise, a
    black box. A Gaussian filter as `method` makes it Metropolis–Hastings with the likelihood that this filter sees.

    Args:
        build: `build(theta) -> StateSpaceModel`, a function that JAX can trace. Noises and the initial belief may
            depend on the parameters. Write it once: another function is compiled anew.
        theta: the parameters and what is known of them, as for `joint`: a pytree of `sp.real`, `sp.positive`,
            `sp.bounded` and numbers, or `sp.Gaussian` over a vector. This is the prior.
        y: measurements (T, m), NaN where an element was not measured; or a list of independent series (Tᵢ, m).
        u: inputs, as for `filter`; for a list, a list of them.
        key: `jax.random.key(seed)`, or the seed.
        method: as for `filter`; `sp.bootstrap(1000)` where not given. The fewer particles, the more steps are refused.
        samples: steps of each chain that are kept.
        warmup: steps of each before these, in which it comes to the posterior and learns how far to step.
        chains: how many, independent of each other.

    Returns:
        `PosteriorSamples`: `samples`, `estimates`, `model`, and how far to trust them: `ess`, `r_hat`.

    Raises:
        ValueError: as `log_posterior`; nothing measured; a prior of whose draws none has a likelihood; under `jax.jit`.
        ImportError: blackjax is not installed (`pip install sigmapoint[mcmc]`).

    Warns where the estimated log-likelihood has a variance above 3 after the warm-up, where the chains do not agree
    (R̂ > 1.1), and where Ctrl-C has ended it: then the samples so far are returned.

    Source: Andrieu, Doucet & Holenstein (2010), section 2.4.2.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> def build(theta):
        ...     return sp.StateSpaceModel(lambda x, u: theta["a"] * x, lambda x, u: x, 0.5 * jnp.eye(1),
        ...                               0.5 * jnp.eye(1), sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> _, y = sp.simulate(build({"a": 0.8}), 20, key=0)
        >>> theta = {"a": sp.bounded(0.5, 0.3, -1.0, 1.0)}
        >>> found = sp.pmmh(build, theta, y, key=1, method=sp.bootstrap(50), warmup=100, samples=200)
        >>> found.samples["a"].shape, bool(found.estimates.low["a"] < 0.8 < found.estimates.high["a"])
        ((4, 200), True)
    """
    posterior = to_sample("pmmh", build, theta, y, u, bootstrap(1000) if method is None else method)
    from sigmapoint.identification.chains import FEWEST, diagnosed, sampled

    key, chains = checks.key("key", key), checks.whole("chains", chains, 1)
    warmup, samples = checks.whole("warmup", warmup, 0), checks.whole("samples", samples, FEWEST)
    (z, log_likelihood, accepted), variance = sampled(posterior, key, chains, warmup, samples)
    found = PosteriorSamples(
        posterior, jnp.asarray(z), jnp.asarray(log_likelihood), float(accepted.mean()), *diagnosed(z), float("nan")
    )
    _warn(found, variance)
    return found


def _warn(found: PosteriorSamples, variance: float) -> None:
    if variance > NOISY:
        warnings.warn(
            f"pmmh: the log-likelihood that the method estimates has a variance of {variance:.2g} where the "
            f"chains are; beyond {NOISY:g} they hardly move: give the method more particles (twice as many halve it), "
            "or a better proposal, as sp.proposals.guided(sp.ekf())",
            stacklevel=3,
        )
    if not found.agree:
        names = ", ".join(name for name, r_hat in zip(found.names, found.r_hat) if r_hat > AGREE)
        warnings.warn(
            f"pmmh: the chains do not agree on {names} (R̂ up to {found.r_hat.max():.3g}): give more samples and a "
            "longer warmup, or theta closer to what is possible",
            stacklevel=3,
        )
