"""State of an F-15 and what is left of its stabilator and lift, from noisy measurements: the simulator is the model.

All twelve states are measured, with noise of a tenth of each state's standard deviation over the flights (20 dB). The
model is a flight simulator (`f15_simulator`), in still air: the velocity is that through the air, so that of turbulence
only the change from one step to the next is process noise. Stabilator and lift are factors that move as random walks.

Source: Wan & van der Merwe, "The Unscented Kalman Filter" (2001), section 7.5, Figure 7.16.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import sigmapoint as sp
from sigmapoint.blackbox import Blackbox
from sigmapoint.problems.f15_mission import LENGTH, SPEED, START, START_STD, TURBULENCE
from sigmapoint.problems.f15_simulator import NAMES, STEP, UNITS, advanced

RATIO = 10.0
"""of the states' standard deviations to those of the noise: 20 dB"""
MEMORY = LENGTH / SPEED
"""[s] of the turbulence"""
CARRIED = TURBULENCE * np.sqrt(2 * MEMORY * STEP)
"""[m] by which turbulence carries the aircraft in a step, as white noise that adds up to the same over a long time"""
CHANGED = TURBULENCE * np.sqrt(2 * STEP / MEMORY)
"""[m/s] by which the velocity through the air changes in a step by turbulence"""
PROCESS_STD = np.array([*[CARRIED] * 3, *[CHANGED] * 3, *[1e-4] * 3, 2e-3, 2e-3, 2e-3])
"""of a step, in the units of the states; for the rates, about what turbulence does to them within a step"""
PRIOR = 0.1
"""standard deviation of both factors at first"""
DRIFT = np.array([0.01, 0.002])
"""standard deviation that each gains in a step: the stabilator may fail, the wing hardly changes"""


class Factors(NamedTuple):
    """What multiplies forces and moments: 1 where nothing has failed."""

    stabilator: Any
    lift: Any


WHOLE = Factors(1.0, 1.0)
THETA = Factors(sp.real(1.0, PRIOR), sp.real(1.0, PRIOR))
SIZE = len(START) + len(THETA)
"""of the joint state"""


def sensors(state: Float[np.ndarray, "R T 12"]) -> Float[np.ndarray, " 12"]:
    """Standard deviations of the noise of the measurements: 20 dB below the states, over all flights."""
    return np.sqrt(state.var(axis=1).mean(axis=0)) / RATIO


def measured(state: Float[np.ndarray, "R T 12"], noise: Float[np.ndarray, " 12"], key: Array) -> np.ndarray:
    """The states with noise of these standard deviations."""
    return state + noise * np.asarray(jax.random.normal(key, state.shape))


def simulator(workers: int) -> Blackbox:
    """The simulator as a function of a model, its points spread over so many processes; `.close()` ends them."""
    return sp.blackbox(advanced, workers=workers)


def states_model(box: Blackbox, factors: Factors, noise: Float[np.ndarray, " 12"]) -> sp.StateSpaceModel:
    """The aircraft with these factors; the input is `f15_simulator.Input`."""

    def dynamics(x: Array, u: Any) -> Array:
        return box(x, u, jnp.stack([jnp.asarray(f, x.dtype) for f in factors]))

    return sp.StateSpaceModel(
        dynamics,
        lambda x, u: x,
        jnp.diag(jnp.asarray(PROCESS_STD) ** 2),
        jnp.diag(jnp.asarray(noise) ** 2),
        sp.Gaussian(jnp.asarray(START), jnp.diag(jnp.asarray(START_STD) ** 2)),
        state_names=NAMES,
        state_units=UNITS,
        observation_names=NAMES,
        observation_units=UNITS,
    )


def joint_model(box: Blackbox, noise: Float[np.ndarray, " 12"]) -> sp.StateSpaceModel:
    """The twelve states and both factors, which are its last states."""
    return sp.joint(lambda factors: states_model(box, factors, noise), THETA, drift=(DRIFT / PRIOR) ** 2)
