"""Runs of terrain-aided navigation: flights, and what a filter believes of the position in each.

Beliefs of all kinds are compared as densities. Particles are points and have none, so every belief is blurred by the
same kernel, a Gaussian about as wide as a filter that has found the place: particles become Gaussians of that width,
and the Gaussian of a Gaussian filter becomes as much wider. A belief that is sure of the wrong place would then count
for more than all others, so every density is mixed with a hundredth of that of dead reckoning.
"""

import warnings
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.special import logsumexp

import sigmapoint as sp
from sigmapoint.densities import LOG_2PI
from sigmapoint.problems import terrain
from sigmapoint.recipe import Recipe

KERNEL = 25.0
"""[m] standard deviation"""
DOUBT = 0.01
"""share of dead reckoning in a density that is scored"""
FAR = 500.0
"""[m] off, a flight is lost: many standard deviations of a filter that has found it, and no ridge"""
LAST = 50
"""instants, a third of a flight"""
AT_ONCE = 50_000
"""particles, in all flights that are worked through together"""


class Flights(NamedTuple):
    """True states [m, m/s] and measured heights [m] of R flights."""

    x: Float[Array, "R T 2"]
    y: Float[Array, "R T 1"]


def flown(runs: int, key: Array) -> Flights:
    """Flights from places and at speeds that are drawn from what filters know of them."""
    model = terrain.model()
    return Flights(*jax.vmap(lambda key: sp.simulate(model, terrain.STEPS, key=key))(jax.random.split(key, runs)))


class Belief(NamedTuple):
    """A mixture of Gaussians of the position, blurred: of one for a Gaussian filter, of narrow ones for particles."""

    place: Float[np.ndarray, "*T N"]
    log_weight: Float[np.ndarray, "*T N"]
    std: Float[np.ndarray, "*T 1"]

    def log_density(self, x: Float[np.ndarray, "*T"]) -> Float[np.ndarray, "*T"]:
        """Natural logarithm of the density [1/m] at one place `x` [m] for each."""
        off = (x[..., None] - self.place) / self.std
        return np.asarray(logsumexp(self.log_weight - off**2 / 2 - np.log(self.std) - LOG_2PI / 2, axis=-1))


class Found(NamedTuple):
    """What a method makes of all flights."""

    error: Float[np.ndarray, "R T"]
    """[m] of the posterior mean of the position"""
    std: Float[np.ndarray, "R T"]
    """[m] as the filter has it"""
    log_density: Float[np.ndarray, "R T"]
    """of the true position, natural logarithm [1/m]"""
    log_likelihood: Float[np.ndarray, " R"]
    """of all heights [1/m] each"""
    unexplained: Int[np.ndarray, " R"]
    """instants at which no particle was possible"""

    @property
    def late(self) -> Float[np.ndarray, " R"]:
        """[m] rms over the last third."""
        return np.sqrt((self.error[:, -LAST:] ** 2).mean(1))

    @property
    def lost(self) -> Float[np.ndarray, " R"]:
        """1 for a flight that ends far off."""
        return 1.0 * ~(np.abs(self.error[:, -1]) < FAR)

    @property
    def inside(self) -> Float[np.ndarray, " R"]:
        """Share of the time that the position is within two standard deviations."""
        return (np.abs(self.error) < 2 * self.std).mean(1)

    @property
    def known(self) -> Float[np.ndarray, " R"]:
        """Logarithm of the density of the true position, mean over time."""
        return self.log_density.mean(1)


def dead_reckoning() -> Belief:
    """What is known of the position without any measurement."""
    nothing = jnp.full((terrain.STEPS, 1), jnp.nan)
    return blurred(sp.filter(terrain.model(), nothing, method=sp.ekf(), keep=("mean", "std")))


def blurred(post: Any) -> Belief:
    """The belief of the position in a result that kept `kept_of` its method."""
    particles = getattr(post, "particles", None)
    if particles is None:
        place, std = (np.asarray(a)[..., :1] for a in (post.mean, post.std))
        return Belief(place, np.zeros_like(place), np.hypot(std, KERNEL))
    place = np.asarray(particles)[..., 0]
    return Belief(place, np.asarray(post.log_weights), np.full_like(place[..., :1], KERNEL))


def kept_of(method: Recipe) -> tuple[str, ...]:
    """What a belief is made of."""
    return ("mean", "std", *(name for name in ("particles", "log_weights") if name in method.posterior.FIELDS))


def belief_of(method: Recipe, y: Float[Array, "T 1"], key: Array) -> Belief:
    """Of one flight."""
    drawing = "particles" in method.posterior.FIELDS
    return blurred(sp.filter(terrain.model(), y, method=method, key=key if drawing else None, keep=kept_of(method)))


def found(method: Recipe, flights: Flights, key: Array) -> Found:
    """All flights by a method, some at a time."""
    size = max(1, AT_ONCE // getattr(method, "particles", 1))
    parts = [
        _some(method, Flights(*(a[i : i + size] for a in flights)), jax.random.fold_in(key, i))
        for i in range(0, len(flights.y), size)
    ]
    return Found(*map(np.concatenate, zip(*parts)))


def _some(method: Recipe, flights: Flights, key: Array) -> Found:
    drawing = "particles" in method.posterior.FIELDS
    with warnings.catch_warnings():  # they are counted
        warnings.filterwarnings("ignore", "no particle explains")
        given = {"method": method, "key": key if drawing else None, "keep": kept_of(method)}
        post = sp.batch(terrain.model(), flights.y, **given)
    truth = np.asarray(flights.x)[..., 0]
    own, least = blurred(post).log_density(truth), dead_reckoning().log_density(truth)
    ess = np.asarray(post.ess) if drawing else np.ones_like(truth)
    return Found(
        error=np.asarray(post.mean)[..., 0] - truth,
        std=np.asarray(post.std)[..., 0],
        log_density=np.logaddexp(np.log(1 - DOUBT) + own, np.log(DOUBT) + least),
        log_likelihood=np.asarray(post.log_likelihood),
        unexplained=(ess == 0).sum(1),
    )
