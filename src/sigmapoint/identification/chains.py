"""Chains from draws of the prior to samples of the posterior, and what these say of themselves."""

import warnings
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.blackbox import unwrapped
from sigmapoint.identification.adaptation import Walked, begun, gains, walked
from sigmapoint.identification.likelihood import LogPosterior
from sigmapoint.identification.pseudo_marginal import Point, estimated

diagnostics: Any = checks.extra("blackjax.diagnostics", "sampling", "mcmc")

TRIED = 16
"""Draws of the prior for each chain, which starts at the best; and estimates of one likelihood, for its variance."""
BLOCK = 50
"""Steps in one call, between which Ctrl-C takes effect."""
FEWEST = 4
"""Samples that R̂ needs."""


class Chains(NamedTuple):
    """What chains have sampled."""

    walked: Walked
    variance: float
    """of the estimated log-likelihood at one place, where the chains were after the warm-up"""


def starts(posterior: LogPosterior, key: Array, count: int) -> Point:
    """For each chain, the best of some draws of the prior.

    Raises:
        ValueError: none of them has a likelihood.
    """
    draw, run = jax.random.split(key)
    z = posterior.prior_draws(draw, count * TRIED)
    points = unwrapped(estimated, posterior, z, jax.random.split(run, count * TRIED))
    value = np.asarray(points.log_likelihood)
    value = np.where(np.isfinite(value), value, -np.inf)
    if not np.isfinite(value).any():
        raise ValueError(
            f"pmmh: the log-likelihood is not finite at any of {len(value)} draws of theta: is build(theta) a model "
            "there, with noises above zero? Give theta closer to what is possible, or a method with more particles"
        )
    best = value.reshape(count, TRIED).argmax(axis=1) + TRIED * np.arange(count)
    best = np.where(np.isfinite(value[best]), best, value.argmax())
    return jax.tree.map(lambda a: a[best], points)


def sampled(posterior: LogPosterior, key: Array, count: int, warmup: int, samples: int) -> Chains:
    """Chains after their warm-up, and how noisy the likelihood was there."""
    start, noise, walk = jax.random.split(key, 3)
    chains = begun(posterior, starts(posterior, start, count))
    blocks = -(-(warmup + samples) // BLOCK)
    gain = gains(warmup, blocks * BLOCK, posterior.unknowns.size).reshape(blocks, BLOCK)
    kept: list[Walked] = []
    variance = float("nan")
    try:
        for i in range(blocks):
            keys = jax.random.split(jax.random.fold_in(walk, i), count)
            chains, block = unwrapped(walked, posterior, chains, keys, jnp.asarray(gain[i], chains.factor.dtype))
            kept.append(jax.tree.map(np.asarray, block))
            if i == max(warmup - 1, 0) // BLOCK:
                variance = _variance(posterior, noise, count, kept[-1])
    except KeyboardInterrupt:
        there = len(kept) * BLOCK - warmup
        if there < FEWEST:
            raise
        warnings.warn(f"pmmh: interrupted; the first {there} of {samples} samples are returned", stacklevel=3)
    past = slice(warmup, warmup + samples)
    return Chains(jax.tree.map(lambda *each: np.concatenate(each, axis=1)[:, past], *kept), variance)


def _variance(posterior: LogPosterior, key: Array, count: int, block: Walked) -> float:
    """Of the log-likelihood in the midst of where chains have been, by as many runs as before: no new program."""
    z = jnp.asarray(np.median(block.z, axis=(0, 1)))
    K = count * TRIED
    points = unwrapped(estimated, posterior, jnp.broadcast_to(z, (K, z.shape[0])), jax.random.split(key, K))
    value = np.asarray(points.log_likelihood)
    return float(value.var()) if np.isfinite(value).all() else float("inf")


def diagnosed(z: Any) -> tuple[Float[np.ndarray, " L"], Float[np.ndarray, " L"]]:
    """Effective sample size and R̂ of each parameter, from samples (C, M, L)."""
    # blackjax promotes types and ranks on the way, which a user may have forbidden.
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        ess, r_hat = _diagnosed(jnp.asarray(z))
    return np.atleast_1d(ess), np.atleast_1d(r_hat)


@jax.jit
def _diagnosed(z: Float[Array, "C M L"]) -> tuple[Array, Array]:
    return diagnostics.ess_bulk(z), diagnostics.rhat(z)
