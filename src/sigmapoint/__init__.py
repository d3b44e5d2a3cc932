"""Nonlinear estimation with sigma-point Kalman filters: hidden states from noisy data, with honest error bars."""

from pathlib import Path
from typing import Any

from sigmapoint.blackbox import blackbox
from sigmapoint.comparison import Comparison, compare
from sigmapoint.filtering import FilterState, Info, filter
from sigmapoint.methods import (
    Method,
    augmented,
    cdkf,
    ckf,
    ekf,
    extended_set,
    ghkf,
    iterated,
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
from sigmapoint.results import Posterior
from sigmapoint.simulation import simulate
from sigmapoint.smoothing import rts, smooth
from sigmapoint.spaces import Manifold, angles
from sigmapoint.storage import load, save

__version__ = "0.1.0"


def report(result: Any, path: Any, **options: Any) -> Path:
    """Write one self-contained, interactive page about a result; see `sigmapoint.reporting.report` for the options.

    Raises:
        ImportError: the page needs `pip install sigmapoint[cli]`.
    """
    from sigmapoint.reporting import report as write

    return write(result, path, **options)


__all__ = [
    "Additive",
    "Comparison",
    "FilterState",
    "Gaussian",
    "Info",
    "Manifold",
    "Method",
    "NonAdditive",
    "OnlineFilter",
    "Posterior",
    "StateSpaceModel",
    "angles",
    "augmented",
    "blackbox",
    "cdkf",
    "ckf",
    "compare",
    "ekf",
    "extended_set",
    "filter",
    "ghkf",
    "iterated",
    "julier_ukf",
    "load",
    "online",
    "report",
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
