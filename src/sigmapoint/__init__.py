"""Nonlinear estimation with sigma-point Kalman filters: hidden states from noisy data, with honest error bars."""

from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from sigmapoint.batching import batch
from sigmapoint.blackbox import blackbox
from sigmapoint.comparison import Comparison, compare
from sigmapoint.diagnosis.diagnostics import diagnose
from sigmapoint.filtering import filter
from sigmapoint.identification.costs import maximum_likelihood, prediction_error
from sigmapoint.identification.coupled import Dual
from sigmapoint.identification.dual import dual
from sigmapoint.identification.dual_results import DualHistory, DualResult, DualState
from sigmapoint.identification.em import EM, em
from sigmapoint.identification.estimates import Estimates, estimates
from sigmapoint.identification.fit import Fit, fit
from sigmapoint.identification.joint import joint
from sigmapoint.identification.likelihood import LogPosterior, log_posterior
from sigmapoint.identification.pmmh import pmmh
from sigmapoint.identification.posterior_samples import PosteriorSamples
from sigmapoint.identification.profile import Profile
from sigmapoint.identification.smc2 import smc2
from sigmapoint.identification.structures import diagonal, full, tied
from sigmapoint.identification.unknown import Unknown, bounded, positive, real
from sigmapoint.learning.drift import annealed, fixed, forgetting, on_diagonal, robbins_monro
from sigmapoint.learning.learner import Learner, learner
from sigmapoint.learning.measurement_noise import learned_noise
from sigmapoint.learning.recurrent import recurrent
from sigmapoint.learning.residual import cross_entropy, residual
from sigmapoint.learning.state import LearnerInfo, LearnerState, Prediction
from sigmapoint.learning.training import History, Progress, Trained, learn
from sigmapoint.methods import (
    Method,
    cdkf,
    ckf,
    ekf,
    ghkf,
    julier_ukf,
    simplex_ukf,
    srcdkf,
    srckf,
    srekf,
    srghkf,
    srjulier_ukf,
    srsimplex_ukf,
    srssckf,
    srukf,
    ssckf,
    ukf,
)
from sigmapoint.model import StateSpaceModel
from sigmapoint.noise import Additive, Gaussian, NonAdditive
from sigmapoint.online import OnlineFilter, online
from sigmapoint.particles import moves, proposals, resampling
from sigmapoint.particles.gaussian_sum.filter import GaussianSumState
from sigmapoint.particles.gaussian_sum.method import GaussianSumMethod, gmsppf, gspf
from sigmapoint.particles.gaussian_sum.mixture import Mixture
from sigmapoint.particles.method import ParticleMethod, auxiliary, bootstrap, ekpf, particle_filter, upf
from sigmapoint.particles.posterior import GaussianSumPosterior, ParticlePosterior
from sigmapoint.particles.rao_blackwell import RaoBlackwellisedState
from sigmapoint.particles.rao_blackwell_method import RaoBlackwellisedMethod, rao_blackwellised
from sigmapoint.particles.smoothing import backward_simulation
from sigmapoint.particles.state import ParticleInfo, ParticleState
from sigmapoint.recipe import Recipe
from sigmapoint.results import Posterior
from sigmapoint.simulation import simulate
from sigmapoint.smoothing.fixed_lag import fixed_lag
from sigmapoint.smoothing.online_smoother import LaggedState, OnlineSmoother, Window, online_smoother
from sigmapoint.smoothing.posterior_linearization import ipls
from sigmapoint.smoothing.smoother import rts, smooth
from sigmapoint.smoothing.trajectories import trajectories
from sigmapoint.smoothing.two_filter import two_filter
from sigmapoint.spaces import Manifold, angles
from sigmapoint.step import FilterState, Info
from sigmapoint.storage import load, save
from sigmapoint.variants import at_mean, augmented, extended_set, iterated

if TYPE_CHECKING:
    from sigmapoint.reporting import report

__version__ = version("sigmapoint")


def __getattr__(name: str) -> Any:
    """`report` is imported when it is asked for: it needs the packages of `sigmapoint[cli]`."""
    if name != "report":
        raise AttributeError(f"module 'sigmapoint' has no attribute {name!r}")
    from sigmapoint.reporting import report

    return report


__all__ = [
    "EM",
    "Additive",
    "Comparison",
    "Dual",
    "DualHistory",
    "DualResult",
    "DualState",
    "Estimates",
    "FilterState",
    "Fit",
    "Gaussian",
    "GaussianSumMethod",
    "GaussianSumPosterior",
    "GaussianSumState",
    "History",
    "Info",
    "LaggedState",
    "Learner",
    "LearnerInfo",
    "LearnerState",
    "LogPosterior",
    "Manifold",
    "Method",
    "Mixture",
    "NonAdditive",
    "OnlineFilter",
    "OnlineSmoother",
    "ParticleInfo",
    "ParticleMethod",
    "ParticlePosterior",
    "ParticleState",
    "Posterior",
    "PosteriorSamples",
    "Prediction",
    "Profile",
    "Progress",
    "RaoBlackwellisedMethod",
    "RaoBlackwellisedState",
    "Recipe",
    "StateSpaceModel",
    "Trained",
    "Unknown",
    "Window",
    "angles",
    "annealed",
    "at_mean",
    "augmented",
    "auxiliary",
    "backward_simulation",
    "batch",
    "blackbox",
    "bootstrap",
    "bounded",
    "cdkf",
    "ckf",
    "compare",
    "cross_entropy",
    "diagnose",
    "diagonal",
    "dual",
    "ekf",
    "ekpf",
    "em",
    "estimates",
    "extended_set",
    "filter",
    "fit",
    "fixed",
    "fixed_lag",
    "forgetting",
    "full",
    "ghkf",
    "gmsppf",
    "gspf",
    "ipls",
    "iterated",
    "joint",
    "julier_ukf",
    "learn",
    "learned_noise",
    "learner",
    "load",
    "log_posterior",
    "maximum_likelihood",
    "moves",
    "on_diagonal",
    "online",
    "online_smoother",
    "particle_filter",
    "pmmh",
    "positive",
    "prediction_error",
    "proposals",
    "rao_blackwellised",
    "real",
    "recurrent",
    "report",
    "resampling",
    "residual",
    "robbins_monro",
    "rts",
    "save",
    "simplex_ukf",
    "simulate",
    "smc2",
    "smooth",
    "srcdkf",
    "srckf",
    "srekf",
    "srghkf",
    "srjulier_ukf",
    "srsimplex_ukf",
    "srssckf",
    "srukf",
    "ssckf",
    "tied",
    "trajectories",
    "two_filter",
    "ukf",
    "upf",
]


def __dir__() -> list[str]:
    """What is meant for use; modules are in there, too."""
    return sorted(__all__)
