"""Nonlinear estimation with sigma-point Kalman filters: hidden states from noisy data, with honest error bars."""

from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from sigmapoint.batching import batch
from sigmapoint.blackbox import blackbox
from sigmapoint.comparison import Comparison, compare
from sigmapoint.diagnostics import diagnose
from sigmapoint.filtering import filter
from sigmapoint.identification.joint import joint
from sigmapoint.identification.unknowns import Estimates, Unknown, bounded, estimates, positive, real
from sigmapoint.learning.drift import annealed, fixed, forgetting, on_diagonal, robbins_monro
from sigmapoint.learning.learner import Learner, learner
from sigmapoint.learning.measurement_noise import learned_noise
from sigmapoint.learning.recurrent import recurrent
from sigmapoint.learning.residual import cross_entropy, residual
from sigmapoint.learning.state import LearnerInfo, LearnerState, Prediction
from sigmapoint.learning.training import Fit, History, Progress, learn
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
    srukf,
    ukf,
)
from sigmapoint.model import StateSpaceModel
from sigmapoint.noise import Additive, Gaussian, NonAdditive
from sigmapoint.online import OnlineFilter, online
from sigmapoint.posterior_linearization import ipls
from sigmapoint.results import Posterior
from sigmapoint.simulation import simulate
from sigmapoint.smoothing import rts, smooth
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
    "Additive",
    "Comparison",
    "Estimates",
    "FilterState",
    "Fit",
    "Gaussian",
    "History",
    "Info",
    "Learner",
    "LearnerInfo",
    "LearnerState",
    "Manifold",
    "Method",
    "NonAdditive",
    "OnlineFilter",
    "Posterior",
    "Prediction",
    "Progress",
    "StateSpaceModel",
    "Unknown",
    "angles",
    "annealed",
    "at_mean",
    "augmented",
    "batch",
    "blackbox",
    "bounded",
    "cdkf",
    "ckf",
    "compare",
    "cross_entropy",
    "diagnose",
    "ekf",
    "estimates",
    "extended_set",
    "filter",
    "fixed",
    "forgetting",
    "ghkf",
    "ipls",
    "iterated",
    "joint",
    "julier_ukf",
    "learn",
    "learned_noise",
    "learner",
    "load",
    "on_diagonal",
    "online",
    "positive",
    "real",
    "recurrent",
    "report",
    "residual",
    "robbins_monro",
    "rts",
    "save",
    "simplex_ukf",
    "simulate",
    "smooth",
    "srcdkf",
    "srckf",
    "srekf",
    "srghkf",
    "srjulier_ukf",
    "srsimplex_ukf",
    "srukf",
    "ukf",
]
