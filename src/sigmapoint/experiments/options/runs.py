"""Runs of the options experiment: markets, real or simulated, and what a method makes of a pair of options in them."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import sigmapoint as sp
from sigmapoint.experiments.floored import LEAST, floored, height
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
    """By a Gaussian filter; one program for all strikes."""

    def one(y: Float[Array, "T 2"], quote: Quote) -> tuple[Array, ...]:
        post = sp.filter(options.model(noise), y, quote, method=method, keep=("mean", "std", "innovation", "nis"))
        mean, std, innovation, nis = map(jnp.asarray, (post.mean, post.std, post.innovation, post.nis))
        return y - innovation, jax.vmap(options.prices)(mean, quote), mean, std, nis

    program = jax.jit(jax.vmap(one))
    return lambda prices, quotes, keys: Found(*map(np.asarray, program(prices, quotes)))


def by_particles(method: sp.ParticleMethod, model: Callable[[], StateSpaceModel] = options.model) -> Estimator:
    """By a particle filter."""

    def found(prices: Float[Array, "M T 2"], quotes: Quote, keys: Array) -> Found:
        y, quotes = jax.tree.map(lambda a: jnp.broadcast_to(a, (len(keys), *a.shape[1:])), (prices, quotes))
        post = sp.batch(model(), y, quotes, method, key=keys[0], keep=("mean", "std", "innovation", "nis", "particles"))
        drawn = jnp.mean(jax.vmap(jax.vmap(jax.vmap(options.prices, (0, None))))(post.particles, quotes), axis=2)
        seen = jax.vmap(jax.vmap(options.prices))(post.mean, quotes)
        return Found(*map(np.asarray, (y - post.innovation, seen, post.mean, post.std, post.nis, drawn)))

    return found


def of_the_authors() -> StateSpaceModel:
    """The model as the particle filters of their program have it.

    To the densities of steps and prices, without their constants, 1e-99 is added: steps of this size are so far out of
    the process noise that all are alike, and weights are likelihood over proposal. And the slope of a price in the
    volatility, which the EKF uses, has exp(−d₁²) in place of exp(−d₁²/2).
    """
    model = options.model()
    noises = (floored(noise, LEAST * height(noise)) for noise in (model.process_noise, model.observation_noise))
    parts = (*noises, lambda x, u: _with_their_slope(x, *u))
    return eqx.tree_at(lambda m: (m.process_noise, m.observation_noise, m.observation), model, parts)


@jax.custom_jvp
def _with_their_slope(x: Array, moneyness: Array, maturity: Array) -> Array:
    return options.prices(x, Quote(moneyness, maturity))


@_with_their_slope.defjvp
def _with_their_slope_jvp(primals: tuple[Array, ...], tangents: tuple[Array, ...]) -> tuple[Array, Array]:
    (x, moneyness, maturity), dx = primals, tangents[0]
    quote = Quote(moneyness, maturity)
    value, by_rate = jax.jvp(lambda x: options.prices(x, quote), (x,), (dx * jnp.array([1.0, 0.0], dx.dtype),))
    d1 = (jnp.log(moneyness) + (x[0] + x[1] ** 2 / 2) * maturity) / (x[1] * jnp.sqrt(maturity))
    by_volatility = moneyness * jnp.sqrt(maturity / (2 * jnp.pi)) * jnp.exp(-(d1**2)) * dx[1]
    return value, by_rate + by_volatility


def errors(prices: Float[np.ndarray, "M T 2"], predicted: Float[np.ndarray, "R T 2"]) -> Float[np.ndarray, "R 2"]:
    """Norm of the errors over strike of call and put, days 104 to 204."""
    return np.linalg.norm((prices - predicted)[:, JUDGED], axis=1)


def trivial(prices: Float[np.ndarray, "M T 2"]) -> Float[np.ndarray, "M T 2"]:
    """Tomorrow's prices as today's; the first day's own."""
    return np.concatenate([prices[:, :1], prices[:, :-1]], axis=1)
