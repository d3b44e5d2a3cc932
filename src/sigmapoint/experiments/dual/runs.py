"""States of a noisy series and the weights of its network, estimated over and over from the same series.

An epoch goes through all samples. It starts with the belief about the weights that the one before ended with, and knows
of the state that the series is normalised.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import sigmapoint as sp
from sigmapoint.filtering import scan
from sigmapoint.identification.cell import Sample
from sigmapoint.identification.costs import Cost
from sigmapoint.identification.coupled import through
from sigmapoint.identification.maximization import Found, Problem, maximized
from sigmapoint.identification.unknowns import Unknowns
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel
from sigmapoint.problems import noisy_series
from sigmapoint.problems.noisy_series import NOISE
from sigmapoint.step import Filter

PRIOR_STD = 0.5
"""Of a weight."""
FIXED = 1e-6
"""Drift of a joint filter, relative to the prior variance of a weight."""
ANNEALED = sp.annealed(1e-3, 0.999, 1e-8)
"""Drift of a dual filter, likewise."""


class Series(NamedTuple):
    """What the runs see, and what they are judged by; a leading axis of runs."""

    clean: Float[Array, "*R T"]
    """of mean 0 and variance 1, or normalised by another series of its kind"""
    noisy: Float[Array, "*R T"]
    process: Float[Array, "*R"]
    """variance of the process noise"""
    start: Any
    """weights at first"""
    best: Any
    """weights that the clean series has, or those learned from it"""


class Curve(NamedTuple):
    """One method; a leading axis of runs."""

    errors: Float[np.ndarray, "*R E"]
    """normalised mean squared error of the filtered state, by epoch"""
    estimate: Float[np.ndarray, "*R T"]
    """of the last epoch"""


Epochs = Callable[[Series, int], Float[Array, "E T"]]
"""The filtered series, epoch by epoch, of one run."""


def curve(estimate: Epochs, series: Series, epochs: int) -> Curve:
    """Every run, one after the other in one program."""
    return Curve(*map(np.asarray, _curve(estimate, series, epochs)))


@eqx.filter_jit
def _curve(estimate: Epochs, series: Series, epochs: int) -> tuple[Array, Array]:
    def run(one: Series) -> tuple[Array, Array]:
        found = estimate(one, epochs)
        return jnp.mean((found - one.clean[None]) ** 2, axis=1) / jnp.var(one.clean), found[-1]

    return jax.lax.map(run, series)


def build(one: Series) -> Callable[[Any], StateSpaceModel]:
    """The model with some weights."""
    order = one.start[0][0].shape[-1]
    initial = sp.Gaussian(jnp.zeros(order), jnp.eye(order))
    return lambda weights: noisy_series.model(weights, one.process, jnp.asarray(NOISE), initial)


def unknown(one: Series) -> Any:
    """The weights to be found."""
    return jax.tree.map(lambda w: sp.real(w, PRIOR_STD), one.start)


def dual(method: Method, cost: Cost | None = None) -> Epochs:
    """Two filters, the drift of the weights annealed."""

    def estimate(one: Series, epochs: int) -> Float[Array, "E T"]:
        both = sp.dual(build(one), unknown(one), ANNEALED, state_method=method, parameter_method=method, cost=cost)
        samples = Sample(jnp.arange(len(one.noisy)), one.noisy[:, None], None, None)

        def again(learner: Any, _: None) -> tuple[Any, Array]:
            learner, kept, _history = through(both, learner, samples)
            return learner, kept["mean"][:, 0]

        return jax.lax.scan(again, both.setup.start(), None, epochs)[1]

    return estimate


def joint(method: Method, drift: float = FIXED) -> Epochs:
    """One filter of states and weights, with a fixed drift."""

    def estimate(one: Series, epochs: int) -> Float[Array, "E T"]:
        model = sp.joint(build(one), unknown(one), drift)
        x = build(one)(one.start).initial
        n = len(x.mean)

        def again(z: sp.Gaussian, _: None) -> tuple[sp.Gaussian, Array]:
            start = sp.Gaussian(jnp.concatenate([x.mean, z.mean]), jax.scipy.linalg.block_diag(x.cov, z.cov))
            run = Filter.of(eqx.tree_at(lambda m: m.initial, model, start), method)
            found, _likelihood, ahead = scan(run, one.noisy[:, None], None, lambda state, _: state.belief.mean[0])
            root = ahead.belief.factor[n:]
            return sp.Gaussian(ahead.belief.mean[n:], root @ root.T), found

        prior = Unknowns.of(unknown(one)).prior
        return jax.lax.scan(again, prior, None, epochs)[1]

    return estimate


def em(method: Method) -> Epochs:
    """Expectation-maximisation of the weights, a step an epoch: what the filter finds with the weights after it."""

    def estimate(one: Series, epochs: int) -> Float[Array, "E T"]:
        problem = Problem(build(one), Unknowns.of(unknown(one)), method, None, None, None)
        assert problem.unknowns is not None
        y = one.noisy[None, :, None]

        def again(found: Found, _: None) -> tuple[Found, Array]:
            found, _log_likelihood = maximized(problem, found, y, None, jnp.ones(y.shape[:2], bool))
            return found, filtered(problem.model(found), one.noisy, method)

        start = Found(problem.unknowns.prior.mean, None, None, None)
        return jax.lax.scan(again, start, None, epochs)[1]

    return estimate


def known(method: Method) -> Epochs:
    """The filter with the best weights, in a single epoch."""

    def estimate(one: Series, epochs: int) -> Float[Array, "1 T"]:
        return filtered(build(one)(one.best), one.noisy, method)[None]

    return estimate


def filtered(model: StateSpaceModel, y: Float[Array, " T"], method: Method) -> Float[Array, " T"]:
    """The newest sample in the state."""
    return scan(Filter.of(model, method), y[:, None], None, lambda state, _: state.belief.mean[0])[0]
