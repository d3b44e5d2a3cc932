"""Training a 2-12-2 network on MacKay's robot arm: extended against sigma-point filters, dense against square root.

Published as learning curves without numbers: Wan & van der Merwe (2001), Figure 7.8 top, "note the slightly lower final
MSE performance of the UKF weight training" (predicting by the mean of the outputs; by the output at the mean the curves
are said to be indistinguishable); van der Merwe & Wan (2001), Figure 2: square-root forms learn as the plain ones do.
Noise annealed, as there; the papers give no settings of it.

The noise has a standard deviation of 0.05, so no network gets below 0.0025 per output.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

import sigmapoint as sp
from sigmapoint.experiments.learning_curves import Curves, curves, orders
from sigmapoint.experiments.learning_figures import learning
from sigmapoint.experiments.results import Mean, Picture, Row, decided, mean_of, publish
from sigmapoint.learning.learner import Learner
from sigmapoint.methods import Method
from sigmapoint.problems import network, robot_arm

SIZES = (2, 12, 2)
WEIGHTS = 62
UNSCENTED = {"alpha": 1.0, "beta": 2.0, "kappa": 3.0 - WEIGHTS}
"""points √3 standard deviations out, as those of the central difference filter"""
METHODS: dict[str, tuple[Method, str]] = {
    "EKF": (sp.ekf(), "on a factor in either form: a derivative needs no points"),
    "UKF": (sp.ukf(**UNSCENTED), "α=1, β=2, κ=3−L"),
    "SR-UKF": (sp.srukf(**UNSCENTED), "α=1, β=2, κ=3−L"),
    "SR-UKF, option 2": (sp.at_mean(sp.srukf(**UNSCENTED)), "predicts by the output at the mean"),
    "SR-UKF, wide": (sp.srukf(), "α=1, β=2, κ=0: points √62 standard deviations out"),
    "CDKF": (sp.cdkf(), "h = √3"),
    "SR-CDKF": (sp.srcdkf(), "h = √3"),
}
RUNS, QUICK_RUNS = 10, 2
EPOCHS, QUICK_EPOCHS = 40, 5
TRAIN, TEST = 200, 400
FLOOR = robot_arm.NOISE**2
PAIRS = (("UKF", "SR-UKF"), ("CDKF", "SR-CDKF"))


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    with jax.enable_x64(True):
        keys = jax.random.split(jax.random.key(seed), 2)
        data = robot_arm.drawn(TRAIN + TEST, keys[0])
        found = trained(data, runs or (QUICK_RUNS if quick else RUNS), QUICK_EPOCHS if quick else EPOCHS, keys[1])
    last = {name: mean_of(c.test[:, -1]) for name, c in found.items()}
    picture = learning({name: c.test for name, c in found.items()}, FLOOR, "mean squared error per output, test set")
    caption = f"Error on {TEST} test rows after each epoch of {TRAIN} rows, mean over the same starts ± standard error."
    return publish(
        out,
        "MacKay's robot arm: a 2-12-2 network trained by Kalman filters",
        findings(found, last),
        rows(found, last),
        [Picture("robot-arm", caption, picture)],
    )


def trained(data: tuple[Any, Any], runs: int, epochs: int, key: Any) -> dict[str, Curves]:
    """Every method from the same starts, in the same order of the same data; the first rows are for training."""
    keys = jax.random.split(key, 2)
    starts = jnp.stack([ravel_pytree(network.started(SIZES, k))[0] for k in jax.random.split(keys[0], runs)])
    order = orders(runs, epochs, TRAIN, keys[1])
    x, d = map(jnp.asarray, data)
    train, test = (x[:TRAIN], d[:TRAIN]), (x[TRAIN:], d[TRAIN:])
    return {name: curves(learner(method), starts, train, order, test) for name, (method, _) in METHODS.items()}


def learner(method: Method) -> Learner:
    """The network before it has seen anything."""
    start = network.started(SIZES, jax.random.key(0))
    return sp.learner(
        network.network, start, noise=FLOOR, method=method, drift=sp.annealed(1e-3, 0.999, floor=1e-9), prior_std=1.0
    )


def rows(found: dict[str, Curves], last: dict[str, Mean]) -> list[Row]:
    """The numbers."""
    mse = [
        _row("test MSE per output after the last epoch", name, mean, METHODS[name][1]) for name, mean in last.items()
    ]
    against = [
        _row("the same, difference to the EKF", name, mean_of(c.test[:, -1] - found["EKF"].test[:, -1]), "")
        for name, c in found.items()
        if name != "EKF"
    ]
    apart = [
        Row("robot-arm", "largest difference between dense and square root, relative, first epoch", root, None,
            float(np.max(np.abs(found[root].test[:, 0] / found[dense].test[:, 0] - 1))), None, mean_count(found))
        for dense, root in PAIRS
    ]  # fmt: skip
    nis = [_row("NIS per output in the last epoch", name, mean_of(c.nis[:, -1]), "") for name, c in found.items()]
    return [*mse, *against, *apart, *nis]


def mean_count(found: dict[str, Curves]) -> int:
    """Number of runs."""
    return len(next(iter(found.values())).test)


def findings(found: dict[str, Curves], last: dict[str, Mean]) -> Sequence[str]:
    """What became of the papers' claims, in words."""
    gain = mean_of(found["EKF"].test[:, -1] - found["UKF"].test[:, -1])
    second = mean_of(found["EKF"].test[:, -1] - found["SR-UKF, option 2"].test[:, -1])
    epochs = found["EKF"].test.shape[1]
    worst = max(last, key=lambda name: last[name].value)
    return (
        f"No network can be better than the noise, {FLOOR:.4f} per output. Mean errors after {epochs} epochs go from "
        f"{min(m.value for m in last.values()):.5f} to {last[worst].value:.5f} ({worst}).",
        "The papers show curves and print no numbers.",
        f'"Slightly lower final MSE of the UKF": {decided(gain)}. EKF minus UKF on the same starts: '
        f"{gain.value:+.1e} ± {gain.spread:.0e}.",
        f'"Indistinguishable with option 2": EKF minus SR-UKF with option 2 is {second.value:+.1e} '
        f"± {second.spread:.0e}.",
    )


def _row(quantity: str, method: str, mean: Mean, note: str) -> Row:
    return Row("robot-arm", quantity, method, None, mean.value, mean.spread, mean.runs, note)
