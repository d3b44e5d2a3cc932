"""Nonlinear estimation with sigma-point Kalman filters: hidden states and parameters, with honest error bars."""

# the model
# learning the state
from sigmapoint.blackbox import blackbox
from sigmapoint.filtering import filter
from sigmapoint.methods import (
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
from sigmapoint.model import Additive, Gaussian, NonAdditive, StateSpaceModel
from sigmapoint.online import online
from sigmapoint.results import Posterior
from sigmapoint.simulation import simulate
from sigmapoint.smoothing import rts, smooth
from sigmapoint.spaces import Manifold, angles
from sigmapoint.storage import load, save

__version__ = "0.1.0"
