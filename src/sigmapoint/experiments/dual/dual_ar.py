"""A noisy chaotic autoregressive series of a 5-3-1 network, another one in each run; see `dual_series`.

Where weights are known, they are those of the very network that made the series. Series of 1000 samples would take
twice as long. Of the joint unscented filter there are two: its points √3 deviations out, as those of the
central-difference filter, and √27. On other series the first was better.
"""

from pathlib import Path
from typing import Any

import jax
from jaxtyping import Array

import sigmapoint as sp
from sigmapoint.experiments.dual import series as dual_series
from sigmapoint.experiments.dual.runs import Series, dual, em, joint
from sigmapoint.experiments.dual.series import Task, noisy, stacked
from sigmapoint.experiments.runs import Runs
from sigmapoint.problems import network, noisy_series

STATES = 27
"""five of the series and 22 weights"""
CLOSE_BY = {"alpha": 1.0, "beta": 2.0, "kappa": 3.0 - STATES}
SIZES = (noisy_series.ORDER, noisy_series.UNITS, 1)


def series(runs: int, samples: int, key: Array) -> Series:
    """A network, a noise and a start for each run."""

    def one(key: Array) -> Series:
        drawn, noise, start = jax.random.split(key, 3)
        raw = noisy_series.drawn(samples, drawn)
        mean, std = raw.mean(), raw.std()
        clean = (raw - mean) / std
        best = noisy_series.rescaled(noisy_series.weights_of(drawn), mean, std)
        process = (noisy_series.DRIVE / std) ** 2
        return Series(clean, noisy(clean, noise), process, network.started(SIZES, start), best)

    return stacked([one(k) for k in jax.random.split(key, runs)])


TASK = Task(
    name="dual-ar",
    title="A noisy chaotic series and its 5-3-1 network, from the noisy series alone",
    series=series,
    runs=Runs(each=10, compared=60, quick=2),
    samples=500,
    epochs=10,
    methods={
        "dual EKF": dual(sp.ekf()),
        "dual SR-UKF": dual(sp.srukf()),
        "dual SR-UKF, maximum likelihood": dual(sp.srukf(), sp.maximum_likelihood()),
        "joint EKF": joint(sp.ekf()),
        "joint SR-UKF": joint(sp.srukf(**CLOSE_BY)),
        "joint SR-UKF, wide": joint(sp.srukf()),
        "joint SR-CDKF": joint(sp.srcdkf()),
        "EM, SR-UKF": em(sp.srukf()),
    },
    claims={"dual": ("dual SR-UKF", "dual EKF"), "joint": ("joint SR-UKF", "joint EKF")},
    quick=("dual EKF", "dual SR-UKF", "joint SR-UKF"),
    shown="dual SR-UKF",
)


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    return dual_series.run(TASK, runs, seed, out, quick)
