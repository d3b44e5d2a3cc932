"""The double inverted pendulum held upright by a controller that is told what a filter estimates, parameters included.

At every step all six states are measured, a joint filter takes that in, the state-dependent Riccati equation is solved
for the state and the parameters as they are estimated then, and the force goes to the cart and into the filter's
prediction. The pendulum itself has the true parameters. The force shows the common factor of the masses, which no fall
without a force does (`problems.pendulum`).

Source: Wan & van der Merwe, "The Unscented Kalman Filter" (2001), section 7.5.1, "Double Inverted Pendulum".
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import sigmapoint as sp
from sigmapoint.identification.estimates import Estimates
from sigmapoint.identification.unknowns import Unknowns
from sigmapoint.methods import Method
from sigmapoint.problems import pendulum
from sigmapoint.problems.pendulum import STEP, TRUTH, Parameters
from sigmapoint.problems.pendulum_control import force
from sigmapoint.step import Filter

JACKKNIFE = np.array([0.5, 0.0, np.deg2rad(25.0), 0.0, np.deg2rad(-24.0), 0.0])
"""[m, m/s, rad, rad/s, rad, rad/s] the published start"""
ANGLE = np.deg2rad(5.0)
"""[rad] both angles start within ± this of it, all equally likely"""
FACTOR = 2.0
"""parameters are first thought to be the true ones times or divided by up to this, equally likely in logarithms"""
SENSORS = np.array([0.01, 0.05, 0.01, 0.05, 0.01, 0.05])
"""[m, m/s, rad, rad/s, rad, rad/s] standard deviations of the measurements"""
DISTURBANCE = 1e-3
"""standard deviation of what is added to each state in a step, in their units"""
PRIOR = 0.5
"""standard deviation of the logarithm of a parameter, as the filter is told"""
STATE_PRIOR = 0.1
"""standard deviation of each state at first, in their units, as the filter is told"""
STRONGEST = 1000.0
"""[N] the force is no larger; with everything known it is 500 to 600 at first"""
PARTS = 2
"""steps of integration of the pendulum within one of the filter"""


class Start(NamedTuple):
    """Where a trial begins."""

    state: Float[Array, "*R 6"]
    factors: Float[Array, "*R 5"]
    """what the filter thinks of the parameters, over the true ones"""


class Trial(NamedTuple):
    """What happened, step by step."""

    state: Float[Array, "*R T 6"]
    mean: Float[Array, "*R T 6"]
    """as estimated"""
    parameters: Any
    """`Estimates` of `Parameters`"""
    force: Float[Array, "*R T"]
    """[N]"""


Control = Callable[[Float[Array, " 6"], Parameters, Float[Array, " 6"]], Float[Array, ""]]
"""The force [N], from the estimated state and parameters and from the true state."""


def adaptive(mean: Float[Array, " 6"], known: Parameters, state: Float[Array, " 6"]) -> Float[Array, ""]:
    """Control by what is estimated."""
    return force(known, mean)


def parameters_known(mean: Float[Array, " 6"], known: Parameters, state: Float[Array, " 6"]) -> Float[Array, ""]:
    """Control by the true parameters and the estimated state."""
    return force(TRUTH, mean)


def all_known(mean: Float[Array, " 6"], known: Parameters, state: Float[Array, " 6"]) -> Float[Array, ""]:
    """Control by the true parameters and the true state: what there is to reach."""
    return force(TRUTH, state)


def starts(runs: int, key: Array) -> Start:
    """Random ones."""
    keys = jax.random.split(key)
    angles = ANGLE * jax.random.uniform(keys[0], (runs, 2), minval=-1.0, maxval=1.0)
    shift = jnp.zeros((runs, 6)).at[:, jnp.array([2, 4])].set(angles)
    return Start(
        jnp.asarray(JACKKNIFE)[None] + shift,
        jnp.exp(jnp.log(FACTOR) * jax.random.uniform(keys[1], (runs, 5), minval=-1.0, maxval=1.0)),
    )


def model(parameters: Parameters, sensors: Float[Array, " 6"]) -> sp.StateSpaceModel:
    """The pendulum with these parameters, all its states measured; the input is the force [N]."""
    return sp.StateSpaceModel(
        lambda x, u: pendulum.moved(parameters, x, u),
        lambda x, u: x,
        DISTURBANCE**2 * jnp.eye(6),
        jnp.diag(sensors**2),
        sp.Gaussian(jnp.asarray(JACKKNIFE), STATE_PRIOR**2 * jnp.eye(6)),
        state_names=("x", "dx", "one", "done", "two", "dtwo"),
        state_units=("m", "m/s", "rad", "rad/s", "rad", "rad/s"),
    )


def trial(method: Method, control: Control, start: Start, sensors: Float[Array, " 6"], steps: int, key: Array) -> Trial:
    """One trial, from one start.

    Args:
        method: of the joint filter.
        control: what the controller is told: `adaptive`, `parameters_known`, `all_known`.
        start: the true state, and what the filter thinks of the parameters.
        sensors: standard deviations of the measurements, in the units of the states.
        steps: of 0.02 s.
        key: of `jax.random`.
    """
    theta = Parameters(*(sp.positive(t * f, PRIOR * t * f) for t, f in zip(TRUTH, start.factors)))
    unknowns = Unknowns.of(theta)
    run = Filter.of(sp.joint(partial(model, sensors=sensors), theta), method)
    noise = jax.random.normal(key, (steps, 2, 6))

    def step(carry: Any, noise: Array) -> Any:
        state, ahead = carry
        now, _ = run.update(ahead, state + sensors * noise[0], jnp.zeros(()))
        mean, z = now.mean[:6], now.mean[6:]
        pushed = jnp.clip(control(mean, unknowns.tree(z), state), -STRONGEST, STRONGEST)
        moved = jax.lax.fori_loop(0, PARTS, lambda _, x: pendulum.moved(TRUTH, x, pushed, STEP / PARTS), state)
        return (moved + DISTURBANCE * noise[1], run.predict(now, pushed)), (state, mean, z, now.std[6:], pushed)

    _, (state, mean, z, std, pushed) = jax.lax.scan(step, (start.state, run.init()), noise)
    return Trial(state, mean, Estimates.of(unknowns, z, std), pushed)
