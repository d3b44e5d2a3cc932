"""European options on an index: interest rate and volatility from the prices that a market quotes.

Black and Scholes price a call and a put, with S the index, X the strike, t the time to maturity, N the normal
distribution function; all over X, so that of S and X only the ratio counts:

    C/X = (S/X) N(d₁) − exp(−r t) N(d₂)              d₁ = (ln(S/X) + (r + σ²/2) t) / (σ √t)
    P/X = exp(−r t) N(−d₂) − (S/X) N(−d₁)            d₂ = d₁ − σ √t

The rate r and the volatility σ are a random walk, S/X and t are known, both prices are measured. At maturity, and
without volatility, the prices are those of their limits, σ √t → 0 from above; derivatives up to the second are finite.

A negative volatility is left to the formula, C(−σ) = −P(σ): no market quotes negative prices, so no belief stays there.
To take |σ| in its place gives the wide prior two modes, between which a sigma-point filter ends up. Dividends are not
in these formulas: those of the index lower the rate that is found.

Source: F. Black, M. Scholes, "The Pricing of Options and Corporate Liabilities", Journal of Political Economy 81
(1973); Wan & van der Merwe, "The Unscented Kalman Filter" (2001), eqs. 7.122 and 7.123. Their noise is not printed:
that here reproduces their Table 7.2.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax.scipy.special import ndtr
from jaxtyping import Array, Float

from sigmapoint.model import StateSpaceModel
from sigmapoint.noise import Gaussian

STATES, UNITS = ("rate", "volatility"), ("1/year", "1/√year")
START, START_VARIANCE = (0.01, 0.15), 0.1
"""Of rate and volatility, before any price is seen."""

Number = Float[Array, "*many"] | float


class Quote(NamedTuple):
    """What is known of an option beside its price: index over strike [1], time to maturity [years]."""

    moneyness: Number
    maturity: Number


class Noise(NamedTuple):
    """Variances: of the daily steps of rate and volatility, and of a price over its strike."""

    rate: float
    volatility: float
    price: float


NOISE = Noise(rate=1e-7, volatility=1e-5, price=1e-5)
PROPOSALS = Noise(rate=1e-4, volatility=1e-4, price=1e-6)
"""Of the filters that propose particles."""


def call(rate: Number, volatility: Number, quote: Quote) -> Float[Array, "*many"]:
    """Price of a call over its strike.

    Args:
        rate: interest rate, continuously compounded [1/year].
        volatility: standard deviation of the index's logarithm [1/√year].
        quote: index over strike (above zero), and time to maturity (zero or more).

    Source: Black & Scholes (1973); Wan & van der Merwe (2001), eq. 7.122.

    Examples:
        >>> from sigmapoint.problems import options
        >>> round(float(options.call(0.05, 0.2, options.Quote(moneyness=1.0, maturity=1.0))), 5)
        0.10451
    """
    d1, d2, discount = _terms(rate, volatility, quote)
    return quote.moneyness * ndtr(d1) - discount * ndtr(d2)


def put(rate: Number, volatility: Number, quote: Quote) -> Float[Array, "*many"]:
    """Price of a put over its strike; arguments as `call`.

    Source: Black & Scholes (1973); Wan & van der Merwe (2001), eq. 7.123.

    Examples:
        >>> from sigmapoint.problems import options
        >>> round(float(options.put(0.05, 0.2, options.Quote(moneyness=1.0, maturity=1.0))), 5)
        0.05574
    """
    d1, d2, discount = _terms(rate, volatility, quote)
    return discount * ndtr(-d2) - quote.moneyness * ndtr(-d1)


def _terms(rate: Number, volatility: Number, quote: Quote) -> tuple[Array, Array, Array]:
    """d₁, d₂ and exp(−r t)."""
    r, sigma, m, t = jnp.broadcast_arrays(*map(jnp.asarray, (rate, volatility, *quote)))
    tiny = float(jnp.finfo(jnp.result_type(r, sigma, m, t)).tiny)
    spread = sigma * jnp.sqrt(jnp.maximum(t, tiny))
    least = tiny ** (1 / 6)  # the second derivatives have its fourth power in a denominator
    spread = jnp.where(jnp.abs(spread) < least, least, spread)
    d1 = (jnp.log(m) + r * t) / spread + spread / 2
    return d1, d1 - spread, jnp.exp(-r * t)


def prices(x: Float[Array, "2"], u: Quote) -> Float[Array, "2"]:
    """Call and put over their strike, of the state (rate, volatility)."""
    return jnp.stack([call(x[0], x[1], u), put(x[0], x[1], u)])


def _unmoved(x: Float[Array, "2"], u: Quote) -> Float[Array, "2"]:
    return x


def model(noise: Noise = NOISE) -> StateSpaceModel:
    """Rate and volatility as a random walk, call and put over their strike as measurements, `Quote` as input.

    Args:
        noise: variances.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> from sigmapoint.problems import options
        >>> known = options.Quote(moneyness=jnp.ones(3), maturity=jnp.array([0.5, 0.4, 0.3]))
        >>> post = sp.filter(options.model(), jnp.full((3, 2), 0.05), known, method=sp.ukf())
        >>> post.mean.shape
        (3, 2)
    """
    return StateSpaceModel(
        dynamics=_unmoved,
        observation=prices,
        process_noise=jnp.diag(jnp.array([noise.rate, noise.volatility])),
        observation_noise=noise.price * jnp.eye(2),
        initial=Gaussian(jnp.array(START), START_VARIANCE * jnp.eye(2)),
        state_names=STATES,
        state_units=UNITS,
        observation_names=("call", "put"),
        observation_units=("1", "1"),
    )
