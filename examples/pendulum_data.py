"""Draw `pendulum.csv` from the model in `pendulum.py`: 300 samples, some measurements missing, units in the headers."""

from pathlib import Path

import jax
import numpy as np
import pandas as pd
from pendulum import STEP, model

import sigmapoint as sp

T = 300
instants = STEP * np.arange(T)
torque = np.round(4.0 * np.sign(np.sin(1.3 * instants)), 1)
u = {"torque": jax.numpy.asarray(torque)}
x, y = (np.asarray(a) for a in sp.simulate(model, T, key=jax.random.key(7), u=u))
kept = np.random.default_rng(7).random(y.shape) > [0.3, 0.05]
kept[120:150, 0] = False  # the camera looks away
y = np.where(kept, y, np.nan)
table = {
    "time [s]": instants,
    "torque [rad/s²]": torque,
    "position [m]": y[:, 0],
    "gyro [rad/s]": y[:, 1],
    "true angle [rad]": x[:, 0],
    "true speed [rad/s]": x[:, 1],
}
pd.DataFrame(table).round(4).to_csv(Path(__file__).with_name("pendulum.csv"), index=False)
