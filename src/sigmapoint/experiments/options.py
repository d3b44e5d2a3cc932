"""Interest rate and volatility from five pairs of options on an index, and tomorrow's prices from them.

Published (Wan & van der Merwe 2001, section 7.6.3, Table 7.2, Figures 7.21 and 7.22): one-step errors of call and put
prices over the strike, strike 2925, "over the last 100 days". The noise is not printed, nor what the errors are; with
that of `problems.options`, and the Euclidean norm of the errors of days 104 to 204, the table is reproduced.

A step ahead is not quite tomorrow: the filters price the options of a day knowing its index, which "trivial" does not.
And Table 7.2 mixes two things. What it prints for particle filters with a proposal, a quarter of the rest, is not a
prediction: such particles are drawn knowing the day's prices, and priced before they are weighted. Therefore each
method has two errors here, a step ahead and having seen the day, and the two noises of the published filters.

The market is simulated, another one in each run, or a folder of data holds it (`problems.options_data`).
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import sigmapoint as sp
from sigmapoint.experiments.options_figures import predictions, smiles, states
from sigmapoint.experiments.options_tables import SHOWN, TABLE, findings, rows
from sigmapoint.experiments.results import Picture, publish
from sigmapoint.methods import Method
from sigmapoint.problems import options, options_market
from sigmapoint.problems.options import Noise, Quote

RUNS, QUICK_RUNS = 100, 4
DAYS = 204


class Found(NamedTuple):
    """What a method makes of a pair of options, in R runs."""

    ahead: Float[np.ndarray, "R T 2"]
    """prices over strike, from the days before"""
    seen: Float[np.ndarray, "R T 2"]
    """the same, having seen them"""
    mean: Float[np.ndarray, "R T 2"]
    """rate and volatility, having seen the prices"""
    std: Float[np.ndarray, "R T 2"]
    nis: Float[np.ndarray, "R T"]


Estimator = Callable[[Float[Array, "M T 2"], Quote, Array], Found]
"""`(prices, quotes, keys)`: M markets, 1 or as many as the R keys; R runs come out, or M where nothing is random."""


def filtered(method: Method, noise: Noise = options.NOISE) -> Estimator:
    """A Gaussian filter."""
    model = options.model(noise)

    def one(y: Float[Array, "T 2"], quote: Quote) -> tuple[Array, ...]:
        post = sp.filter(model, y, quote, method=method, keep=("mean", "std", "innovation", "nis"))
        return y - post.innovation, jax.vmap(options.prices)(post.mean, quote), post.mean, post.std, post.nis

    return lambda y, quote, keys: Found(*map(np.asarray, jax.vmap(one)(y, quote)))
