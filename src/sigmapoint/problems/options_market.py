"""A simulated market of options on an index, in which rate, volatility and smile are known.

The index S is a geometric Brownian motion; its rate r and the logarithm of its volatility σ wander slowly about their
means, x⁺ = m + a (x − m) + s √(1 − a²) ε. Each strike X is quoted at a volatility of its own, the smile

    σ(X) = σ (1 − k + 4 k²),    k = ln(X/S),

which is higher for low strikes than for high ones, as index options are. Prices are those of Black and Scholes with
σ(X), and a little noise; none is below zero. The numbers are ours, of the size that markets have.
"""

import math
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Shaped

from sigmapoint.problems import options
from sigmapoint.problems.options import Quote

STRIKES = (2925, 3025, 3125, 3225, 3325)
"""[index points]"""
DAYS, YEAR = 222, 260
"""trading days of a market, and of a year"""
FINAL = 224
"""the trading day of maturity, counted from 1"""
INDEX = 3200.0
"""[index points] on the first day"""
MEMORY = 260.0
"""[trading days] of rate and volatility: their daily steps are about those that the filters take them to have"""
RATE, RATE_SPREAD = 0.05, 0.005
"""[1/year] mean and standard deviation"""
VOLATILITY, VOLATILITY_SPREAD = 0.15, 0.25
"""[1/√year] median; [1] standard deviation of its logarithm"""
SKEW, CURVATURE = 1.0, 4.0
"""of the smile"""
PRICE_NOISE = 0.003
"""[1] standard deviation of a price over its strike"""


class Market(NamedTuple):
    """Calls and puts of K strikes, all of the same maturity, over T trading days."""

    strikes: tuple[int, ...]
    """[index points]"""
    dates: Shaped[np.ndarray, "T"] | None
    """where it is a real one"""
    maturity: Float[np.ndarray, "T"]
    """[years] to go"""
    spot: Float[np.ndarray, "T"]
    """[index points] the index"""
    call: Float[np.ndarray, "T K"]
    """[index points] prices"""
    put: Float[np.ndarray, "T K"]

    def quote(self, strike: int) -> Quote:
        """Index over strike and time to maturity, the input of `options.model`."""
        return Quote(jnp.asarray(self.spot / strike), jnp.asarray(self.maturity))

    def prices(self, strike: int) -> Float[Array, "T 2"]:
        """Call and put over their strike, its measurements."""
        k = self.strikes.index(strike)
        return jnp.asarray(np.stack([self.call[:, k], self.put[:, k]], axis=1) / strike)

    def until(self, day: int) -> "Market":
        """The first `day` trading days."""
        dates = None if self.dates is None else self.dates[:day]
        return Market(self.strikes, dates, *(part[:day] for part in self[2:]))


class Truth(NamedTuple):
    """What a simulated market is made of."""

    rate: Float[np.ndarray, "T"]
    """[1/year]"""
    volatility: Float[np.ndarray, "T K"]
    """[1/√year] that each strike is quoted at"""


def maturity(days: int) -> Float[np.ndarray, "T"]:
    """Time to maturity [years] on trading days 1 to `days`."""
    return (FINAL - np.arange(1, days + 1)) / YEAR


def simulated(key: Array, days: int = DAYS) -> tuple[Market, Truth]:
    """A market, and what it is made of.

    Args:
        key: of `jax.random`.
        days: trading days, at most `FINAL`.

    Raises:
        ValueError: more days than there are to maturity.

    Examples:
        >>> import jax
        >>> from sigmapoint.problems import options_market
        >>> market, truth = options_market.simulated(jax.random.key(0), days=100)
        >>> market.prices(3225).shape, truth.volatility.shape
        ((100, 2), (100, 5))
    """
    if not 1 <= days <= FINAL:
        raise ValueError(f"days must be 1 to {FINAL}, the day of maturity; got {days}")
    index, call, put, rate, volatility = map(np.asarray, _drawn(key, days))
    return Market(STRIKES, None, maturity(days), index, call, put), Truth(rate, volatility)


@partial(jax.jit, static_argnames="days")
def _drawn(key: Array, days: int) -> tuple[Array, ...]:
    """Index (T,), calls and puts (T, K), rate (T,), volatility (T, K)."""
    walks = jax.random.normal(key, (3, days))
    rate = RATE + RATE_SPREAD * _wandering(walks[0])
    volatility = VOLATILITY * jnp.exp(VOLATILITY_SPREAD * _wandering(walks[1]))
    steps = (rate - volatility**2 / 2) / YEAR + volatility / YEAR**0.5 * walks[2]
    index = INDEX * jnp.exp(jnp.cumsum(steps) - steps[0])
    strikes = jnp.array([STRIKES], index.dtype)
    quote = Quote(index[:, None] / strikes, jnp.asarray(maturity(days), index.dtype)[:, None])
    quoted = smile(volatility[:, None], index[:, None] / strikes)
    noise = PRICE_NOISE * jax.random.normal(jax.random.fold_in(key, 1), (2, days, len(STRIKES)))
    exact = jnp.stack([price(rate[:, None], quoted, quote) for price in (options.call, options.put)])
    call, put = strikes[None] * jnp.maximum(exact + noise, 0)
    return index, call, put, rate, quoted


def _wandering(shocks: Float[Array, " T"]) -> Float[Array, " T"]:
    """A stationary Gauss-Markov series of mean 0 and standard deviation 1."""
    a = math.exp(-1 / MEMORY)

    def step(x: Array, shock: Array) -> tuple[Array, Array]:
        x = a * x + math.sqrt(1 - a**2) * shock
        return x, x

    return jnp.concatenate([shocks[:1], jax.lax.scan(step, shocks[0], shocks[1:])[1]])


def smile(volatility: Float[Array, "*#many"], moneyness: Float[Array, "*#many"]) -> Float[Array, "*many"]:
    """Volatility [1/√year] that an option is quoted at; higher than `volatility` away from the money."""
    k = -jnp.log(moneyness)
    return volatility * (1 - SKEW * k + CURVATURE * k**2)
