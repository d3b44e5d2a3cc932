"""Runs of the synthetic experiment: series, methods in their cases, and the error of each run."""

import warnings
from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import sigmapoint as sp
from sigmapoint.experiments.floored import LEAST, floored
from sigmapoint.problems import gamma_autoregression as problem
from sigmapoint.recipe import Recipe

PARTICLES = 200


def untold(least: float) -> sp.StateSpaceModel:
    """The model as the filters of the published table have it, with `least` added to every likelihood."""
    model = problem.model(noise_mean=0.0)
    return eqx.tree_at(lambda m: m.observation_noise, model, floored(model.observation_noise, least))


def variance(value: float) -> Float[Array, "1 1"]:
    """As a covariance."""
    return jnp.full((1, 1), value)


UNSCENTED = sp.augmented(sp.ukf(alpha=1.0, beta=0.0, kappa=2.0))
ITERATED = sp.iterated(sp.ekf(), 5)
Q_EKF, Q_UKF, R = variance(7.5), variance(1.5), variance(0.1)
OF_EKF = sp.proposals.carried(sp.ekf(), process_noise=Q_EKF, observation_noise=R)
OF_UKF = sp.proposals.carried(UNSCENTED, process_noise=Q_UKF, observation_noise=R)
GAUSSIAN = sp.proposals.prior(process_noise=variance(problem.NOISE.variance))

particles = partial(sp.particle_filter, PARTICLES, resampling=sp.resampling.residual, threshold=1.0)
"""resampled at every step, as in the paper"""
moved = partial(particles, move=sp.moves.independence())

EKF, UKF, ITERATED_EKF = (sp.ekf(), ""), (UNSCENTED, "α=1, β=0, κ=2, augmented"), (ITERATED, "5 passes, no particle")
WIDE = "proposals: {}Q = {}, R = 0.1"


class Case(NamedTuple):
    """What filters are told, and which filters."""

    name: str
    model: sp.StateSpaceModel
    methods: Mapping[str, tuple[Any, str]]
    """and a note on each"""


def cases() -> tuple[Case, ...]:
    """The published table, the same with weights as logarithms, and the same told the truth."""
    note_ekf, note_ukf = WIDE.format("", 7.5), WIDE.format("α=1, β=0, κ=2, augmented; ", 1.5)
    proposing = {"PF-EKF": (particles(proposal=OF_EKF), note_ekf), "UPF": (particles(proposal=OF_UKF), note_ukf)}
    published = {
        "EKF": EKF,
        "UKF": UKF,
        "PF": (particles(), "drawn from the gamma"),
        "PF+MCMC": (moved(), "drawn from the gamma"),
        "PF-EKF": proposing["PF-EKF"],
        "PF-EKF+MCMC": (moved(proposal=OF_EKF), note_ekf),
        "UPF": proposing["UPF"],
        "UPF+MCMC": (moved(proposal=OF_UKF), note_ukf),
    }
    logarithms = {
        "iterated EKF": ITERATED_EKF,
        "PF": published["PF"],
        "PF, Gaussian draws": (particles(proposal=GAUSSIAN), "drawn from N(f(x), 3/4)"),
        **proposing,
    }
    truth = {
        "EKF": EKF,
        "UKF": UKF,
        "SR-CDKF": (sp.srcdkf(), "h = √3"),
        "GHKF(5)": (sp.ghkf(5), ""),
        "iterated EKF": ITERATED_EKF,
        "PF": (particles(), "drawn from the gamma"),
        "PF-EKF": (particles(proposal=sp.proposals.carried(sp.ekf())), "proposals with the noises of the model"),
        "UPF": (particles(proposal=sp.proposals.carried(UNSCENTED)), "proposals with the noises of the model"),
        "PF, guided": (particles(proposal=sp.proposals.guided(ITERATED)), "by an iterated EKF for each particle"),
    }
    return (
        Case("as published", untold(LEAST), published),
        Case("with logarithms of weights", untold(0.0), logarithms),
        Case("told the mean of the noise as well", problem.model(), truth),
    )


class Series(NamedTuple):
    """True states and measurements of R runs, t = 0 … 60."""

    x: Float[Array, "R T 1"]
    y: Float[Array, "R T 1"]


@jax.jit
def series(keys: Array) -> Series:
    """A run for each key."""
    return Series(*jax.vmap(problem.drawn)(keys))


class Found(NamedTuple):
    """What a method makes of all runs."""

    mean: Float[np.ndarray, "R T"]
    """of the posterior"""
    rmse: Float[np.ndarray, " R"]
    """over t = 1 … 60"""
    unexplained: int
    """steps, of all runs, at which no particle was possible"""


def found(case: Case, method: Recipe, series: Series, key: Array) -> Found:
    """All runs of a method, by one program for cases of the same kind."""
    t = jnp.broadcast_to(problem.times(), series.y.shape[:2])
    with warnings.catch_warnings():  # they are counted
        warnings.filterwarnings("ignore", "no particle explains")
        post = sp.batch(case.model, series.y, t, method, key=key, keep=("mean",))
    mean, x = (np.asarray(a)[..., 0] for a in (post.mean, series.x))
    unexplained = int((np.asarray(post.ess) == 0).sum()) if isinstance(method, sp.ParticleMethod) else 0
    return Found(mean, np.sqrt(((mean - x)[:, 1:] ** 2).mean(1)), unexplained)
