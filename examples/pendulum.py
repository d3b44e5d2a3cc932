"""A pendulum with a noisy motor: angle and speed from measurements of its horizontal position and of its speed.

    sigmapoint run examples/pendulum.py examples/pendulum.csv --method srukf --smooth --out out/pendulum
    sigmapoint compare examples/pendulum.py examples/pendulum.csv

`pendulum.csv` was drawn from this model (`python examples/pendulum_data.py`); empty cells were not measured.
"""

import jax.numpy as jnp

import sigmapoint as sp

measurements = ["position", "gyro"]
inputs = {"torque": "torque"}
time = "time"
truth = {"angle": "true angle", "speed": "true speed"}

STEP, LENGTH, GRAVITY = 0.02, 0.5, 9.81  # s, m, m/s²


def swing(x, u):
    """One step of the pendulum, `torque` over its moment of inertia [rad/s²]."""
    speed = x[1] + STEP * (u["torque"] - GRAVITY / LENGTH * jnp.sin(x[0]) - 0.1 * x[1])
    return jnp.stack([x[0] + STEP * speed, speed])


model = sp.StateSpaceModel(
    dynamics=swing,
    observation=lambda x, u: jnp.stack([LENGTH * jnp.sin(x[0]), x[1]]),
    process_noise=jnp.diag(jnp.array([1e-6, 4e-3])),
    observation_noise=jnp.diag(jnp.array([2e-2, 2e-1])) ** 2,
    initial=sp.Gaussian(jnp.array([0.5, 0.0]), jnp.diag(jnp.array([0.5, 1.0]))),
    state_names=("angle", "speed"),
    state_units=("rad", "rad/s"),
    observation_names=("position", "gyro"),
)
