"""The double inverted pendulum seen by three sensors: place and speed of the cart, and the angle of the lower rod.

Nothing is measured of the upper rod, nor the speed of the lower one: a filter finds them by what they do to the rest.
The force is that of the state-dependent Riccati controller (`problems.pendulum_control`), which is told either the true
state, and then a filter only watches, or what the filter estimates. The level of the sensors' noise is given in dB:
its variance is the mean square of what is measured, over trials with everything known, divided by 10^(dB/10).

Source: Wan & van der Merwe, "The Unscented Kalman Filter" (2001), section 7.3.1, Figure 7.5.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import sigmapoint as sp
from sigmapoint.methods import Method
from sigmapoint.problems import pendulum
from sigmapoint.problems.pendulum import STEP, TRUTH
from sigmapoint.problems.pendulum_adaptive import DISTURBANCE, JACKKNIFE, PARTS, STRONGEST
from sigmapoint.problems.pendulum_control import force
from sigmapoint.step import Filter

MEASURED = 3
"""states at the head of (x, ẋ, θ₁, θ̇₁, θ₂, θ̇₂) that are measured"""
SPREAD = np.array([0.02, 0.02, np.deg2rad(1.0), 0.02, np.deg2rad(1.0), 0.02])
"""[m, m/s, rad, rad/s, rad, rad/s] standard deviations of the starts about the published one"""


class Told(NamedTuple):
    """What a filter is told of the start and of what disturbs the pendulum."""

    mean: Float[Array, " 6"]
    std: Float[Array, " 6"]
    """[m, m/s, rad, rad/s, rad, rad/s]"""
    disturbance: Float[Array, ""]
    """standard deviation of what is added to each state in a step, in their units"""


class Noise(NamedTuple):
    """What is random in a trial, in standard deviations."""

    sensors: Float[Array, "*R T 3"]
    disturbance: Float[Array, "*R T 6"]


class Trial(NamedTuple):
    """What happened, step by step."""

    state: Float[Array, "*R T 6"]
    mean: Float[Array, "*R T 6"]
    """as estimated, and as the controller is told"""
    force: Float[Array, "*R T"]
    """[N]"""


def truth() -> Told:
    """How it is."""
    return Told(jnp.asarray(JACKKNIFE), jnp.asarray(SPREAD), jnp.asarray(DISTURBANCE))


def starts(runs: int, key: Array) -> Float[Array, "R 6"]:
    """Random ones, Gaussian about the published one."""
    return jnp.asarray(JACKKNIFE)[None] + jnp.asarray(SPREAD)[None] * jax.random.normal(key, (runs, 6))


def noise(runs: int, steps: int, key: Array) -> Noise:
    """That of trials of so many steps of 0.02 s."""
    keys = jax.random.split(key)
    return Noise(
        jax.random.normal(keys[0], (runs, steps, MEASURED)),
        jax.random.normal(keys[1], (runs, steps, 6)),
    )


def sensors(state: Float[np.ndarray, "R T 6"], decibels: float) -> Float[np.ndarray, " 3"]:
    """Standard deviations of the sensors' noise [m, m/s, rad], for a level [dB] below what is measured.

    Args:
        state: trials with everything known.
        decibels: ten times the logarithm to base 10 of signal power over noise power.

    Examples:
        >>> import numpy as np
        >>> from sigmapoint.problems import pendulum_state
        >>> pendulum_state.sensors(np.ones((1, 5, 6)), 20.0).tolist()
        [0.1, 0.1, 0.1]
    """
    return np.sqrt((state[..., :MEASURED] ** 2).mean((0, 1)) / 10 ** (decibels / 10))


def model(told: Told, sensors: Float[Array, " 3"]) -> sp.StateSpaceModel:
    """The pendulum as a filter has it; the input is the force [N]."""
    return sp.StateSpaceModel(
        lambda x, u: pendulum.moved(TRUTH, x, u),
        lambda x, u: x[:MEASURED],
        told.disturbance**2 * jnp.eye(6),
        jnp.diag(sensors**2),
        sp.Gaussian(told.mean, jnp.diag(told.std**2)),
        state_names=("x", "dx", "one", "done", "two", "dtwo"),
        state_units=("m", "m/s", "rad", "rad/s", "rad", "rad/s"),
    )


def held(start: Float[Array, " 6"], noise: Noise) -> Trial:
    """A trial in which the controller is told the true state.

    Args:
        start: the true state.
        noise: of one trial; that of the sensors is of no account.
    """

    def step(state: Array, added: Array) -> Any:
        pushed = _pushed(state)
        return _moved(state, pushed, added), (state, pushed)

    state, pushed = jax.lax.scan(step, start, noise.disturbance)[1]
    return Trial(state, state, pushed)


def watched(method: Method, told: Told, sensors: Float[Array, " 3"], trial: Trial, noise: Noise) -> Trial:
    """What a filter makes of a trial that it has no part in.

    Args:
        method: the filter.
        told: what it is told.
        sensors: standard deviations of their noise [m, m/s, rad].
        trial: by `held`.
        noise: of one trial.
    """
    y = trial.state[:, :MEASURED] + sensors[None] * noise.sensors
    run = Filter.of(model(told, sensors), method)

    def step(ahead: Any, seen: tuple[Array, Array]) -> Any:
        now, _ = run.update(ahead, seen[0], jnp.zeros(()))
        return run.predict(now, seen[1]), now.mean

    return trial._replace(mean=jax.lax.scan(step, run.init(), (y, trial.force))[1])


def trusted(method: Method, told: Told, sensors: Float[Array, " 3"], start: Float[Array, " 6"], noise: Noise) -> Trial:
    """A trial in which the controller is told what a filter estimates.

    Args:
        method: the filter.
        told: what it is told.
        sensors: standard deviations of their noise [m, m/s, rad].
        start: the true state.
        noise: of one trial.
    """
    run = Filter.of(model(told, sensors), method)

    def step(carry: Any, noise: Noise) -> Any:
        state, ahead = carry
        now, _ = run.update(ahead, state[:MEASURED] + sensors * noise.sensors, jnp.zeros(()))
        pushed = _pushed(now.mean)
        return (_moved(state, pushed, noise.disturbance), run.predict(now, pushed)), (state, now.mean, pushed)

    return Trial(*jax.lax.scan(step, (start, run.init()), noise)[1])


def _pushed(state: Array) -> Array:
    return jnp.clip(force(TRUTH, state), -STRONGEST, STRONGEST)


def _moved(state: Array, pushed: Array, added: Array) -> Array:
    state = jax.lax.fori_loop(0, PARTS, lambda _, x: pendulum.moved(TRUTH, x, pushed, STEP / PARTS), state)
    return state + DISTURBANCE * added
