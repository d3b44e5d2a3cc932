"""Runs of the options experiment: markets, real or simulated, and what a method makes of a pair of options in them."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import sigmapoint as sp
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel
from sigmapoint.problems import options, options_market
from sigmapoint.problems.options import Noise, Quote
from sigmapoint.problems.options_market import Market, Truth

DAYS = 204
JUDGED = slice(103, DAYS)
"""days 104 to 204, counted from 1"""


class Found(NamedTuple):
    """What a method makes of a pair of options, in R runs."""

    ahead: Float[np.ndarray, "R T 2"]
    """prices over strike, from those of the days before"""
    seen: Float[np.ndarray, "R T 2"]
    """the same from those of the day as well"""
    mean: Float[np.ndarray, "R T 2"]
    """rate and volatility, from those of the day as well"""
    std: Float[np.ndarray, "R T 2"]
    nis: Float[np.ndarray, "R T"]
    drawn: Float[np.ndarray, "R T 2"] | None = None
    """prices over strike, mean over the particles as drawn, all of the same weight"""


Estimator = Callable[[Float[Array, "M T 2"], Quote, Array], Found]
"""`(prices, quotes, keys)` of M markets, one or as many as keys: a run for each key, or M where nothing is random."""


class Markets(NamedTuple):
    """M markets of the same strikes; what they are made of, where they are simulated."""

    markets: tuple[Market, ...]
    truths: tuple[Truth, ...]

    @property
    def real(self) -> bool:
        """Not simulated."""
        return not self.truths

    @property
    def strikes(self) -> tuple[int, ...]:
        """[index points]"""
        return self.markets[0].strikes

    def prices(self, strike: int) -> Float[Array, "M T 2"]:
        """Call and put over their strike."""
        return jnp.stack([market.prices(strike) for market in self.markets])

    def quotes(self, strike: int) -> Quote:
        """Index over strike, time to maturity [years], (M, T) each."""
        return jax.tree.map(lambda *each: jnp.stack(each), *(market.quote(strike) for market in self.markets))

    def volatility(self, strike: int) -> Float[np.ndarray, "M T"]:
        """True one [1/√year]; none of a real market."""
        return np.stack([truth.volatility[:, self.strikes.index(strike)] for truth in self.truths])


def simulated(keys: Array) -> Markets:
    """A market for each key."""
    each = [options_market.simulated(key, DAYS) for key in keys]
    return Markets(tuple(market for market, _ in each), tuple(truth for _, truth in each))


def loaded(folder: Path) -> Markets:
    """The one in a folder of data.

    Raises:
        ValueError: fewer days than are judged; and as `options_data.ftse100`.
    """
    from sigmapoint.problems.options_data import ftse100

    market = ftse100(folder)
    if len(market.spot) < DAYS:
        raise ValueError(f"{folder} has {len(market.spot)} trading days; this experiment needs {DAYS}")
    return Markets((market.until(DAYS),), ())


def filtered(method: Method, noise: Noise = options.NOISE) -> Estimator:
    """By a Gaussian filter."""
    return lambda prices, quotes, keys: _found(options.model(noise), method, prices, quotes)


def _found(model: StateSpaceModel, method: Method, prices: Float[Array, "M T 2"], quotes: Quote) -> Found:
    def one(y: Float[Array, "T 2"], quote: Quote) -> tuple[Array, ...]:
        post = sp.filter(model, y, quote, method=method, keep=("mean", "std", "innovation", "nis"))
        mean, std, innovation, nis = map(jnp.asarray, (post.mean, post.std, post.innovation, post.nis))
        return y - innovation, jax.vmap(options.prices)(mean, quote), mean, std, nis

    return Found(*map(np.asarray, jax.vmap(one)(prices, quotes)))


def by_particles(method: sp.ParticleMethod) -> Estimator:
    """By a particle filter."""

    def found(prices: Float[Array, "M T 2"], quotes: Quote, keys: Array) -> Found:
        y, quotes = jax.tree.map(lambda a: jnp.broadcast_to(a, (len(keys), *a.shape[1:])), (prices, quotes))
        post = sp.batch(
            options.model(), y, quotes, method, key=keys[0], keep=("mean", "std", "innovation", "nis", "particles")
        )
        drawn = jnp.mean(jax.vmap(jax.vmap(jax.vmap(options.prices, (0, None))))(post.particles, quotes), axis=2)
        seen = jax.vmap(jax.vmap(options.prices))(post.mean, quotes)
        return Found(*map(np.asarray, (y - post.innovation, seen, post.mean, post.std, post.nis, drawn)))

    return found


def errors(prices: Float[np.ndarray, "M T 2"], predicted: Float[np.ndarray, "R T 2"]) -> Float[np.ndarray, "R 2"]:
    """Norm of the errors over strike of call and put, days 104 to 204."""
    return np.linalg.norm((prices - predicted)[:, JUDGED], axis=1)


def trivial(prices: Float[np.ndarray, "M T 2"]) -> Float[np.ndarray, "M T 2"]:
    """Tomorrow's prices as today's; the first day's own."""
    return np.concatenate([prices[:, :1], prices[:, :-1]], axis=1)
