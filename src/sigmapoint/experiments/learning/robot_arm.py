"""Training a 2-12-2 network on MacKay's robot arm: extended against sigma-point filters, dense against square root.

Published as learning curves without numbers: Wan & van der Merwe (2001), Figure 7.8 top, "note the slightly lower final
MSE performance of the UKF weight training" (predicting by the mean of the outputs; by the output at the mean the curves
are said to be indistinguishable); van der Merwe & Wan (2001), Figure 2: square-root forms learn as the plain ones do.
The process noise is annealed and added to the diagonal, as there (without their settings), and once more a forgetting
factor, with which both forms are the same filter. The prior of the weights (0.3) and both rates are the best of a small
sweep on other data: priors .2 to 2, annealing from 1e-4 to 1e-2 by .998 to .9995, with correlations kept or not.

The noise has a standard deviation of 0.05, so no network gets below 0.0025 per output.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import sigmapoint as sp
from sigmapoint.experiments.learning.curves import Curves, curves, orders
from sigmapoint.experiments.learning.figures import learning
from sigmapoint.experiments.publishing.results import (
    Claim,
    Mean,
    Picture,
    Row,
    ahead,
    decided,
    mean_of,
    plus_minus,
    positive,
    publish,
    row_of,
)
from sigmapoint.experiments.runs import Runs, alike
from sigmapoint.learning.drift import Drift
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
DRIFTS = {
    "annealed": sp.on_diagonal(sp.annealed(1e-3, 0.999, floor=1e-9)),
    "forgetting": sp.forgetting(0.999),
}
EXACT = "forgetting"
"""the same filter in both forms"""
PRIOR = 0.3
COMPARED = ("EKF", "UKF")
"""by the claim"""
RUNS = Runs(each=10, compared=100, quick=2)
EPOCHS, QUICK_EPOCHS = 40, 5
TRAIN, TEST = 200, 2000
FLOOR = robot_arm.NOISE**2
PAIRS = (("UKF", "SR-UKF"), ("CDKF", "SR-CDKF"))


_row = partial(row_of, "robot-arm")


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    with jax.enable_x64(True):
        keys = jax.random.split(jax.random.key(seed), 2)
        data = robot_arm.drawn(TRAIN + TEST, keys[0])
        counts = RUNS.of(METHODS, COMPARED, runs, quick)
        epochs, drifts = (QUICK_EPOCHS, {EXACT: DRIFTS[EXACT]}) if quick else (EPOCHS, DRIFTS)
        found = {name: trained(data, drift, counts, epochs, keys[1]) for name, drift in drifts.items()}
    caption = f"test set of {TEST} rows after each epoch of {TRAIN}, mean over the same starts ± standard error."
    pictures = [
        Picture(
            f"robot-arm-{name}",
            f"{name.capitalize()}: error on a {caption}",
            learning({method: c.test for method, c in alike(each).items()}, FLOOR, "mean squared error per output"),
        )
        for name, each in found.items()
    ]
    return publish(
        out,
        "MacKay's robot arm: a 2-12-2 network trained by Kalman filters",
        claim(found),
        findings(found),
        [row for name, each in found.items() for row in rows(name, each)] + apart(found[EXACT]),
        pictures,
    )


def trained(data: tuple[Any, Any], drift: Drift, counts: Mapping[str, int], epochs: int, key: Any) -> dict[str, Curves]:
    """Methods, each from so many of the same starts, in the same order of the same data; the first rows are for
    training."""
    keys, runs = jax.random.split(key, 2), max(counts.values())
    starts = network.starts(SIZES, runs, keys[0])
    order = orders(runs, epochs, TRAIN, keys[1])
    x, d = map(jnp.asarray, data)
    train, test = (x[:TRAIN], d[:TRAIN]), (x[TRAIN:], d[TRAIN:])
    return {
        name: curves(learner(METHODS[name][0], drift), starts[:count], train, order[:count], test)
        for name, count in counts.items()
    }


def learner(method: Method, drift: Drift) -> Learner:
    """The network before it has seen anything."""
    start = network.started(SIZES, jax.random.key(0))
    return sp.learner(network.network, start, noise=FLOOR, method=method, drift=drift, prior_std=PRIOR)


def last(found: dict[str, Curves]) -> dict[str, Mean]:
    """Mean errors after the last epoch, on the runs that all have."""
    return {name: mean_of(c.test[:, -1]) for name, c in alike(found).items()}


def rows(drift: str, found: dict[str, Curves]) -> list[Row]:
    """The numbers with one kind of drift."""
    mse = [
        _row(f"{drift}: test MSE per output after the last epoch", name, mean, METHODS[name][1])
        for name, mean in last(found).items()
    ]
    against = [
        _row(f"{drift}: the same, difference to the EKF", name, ahead(c.test[:, -1], found["EKF"].test[:, -1]), "")
        for name, c in found.items()
        if name != "EKF"
    ]
    nis = [
        _row(f"{drift}: NIS per output in the last epoch", name, mean_of(c.nis[:, -1]), "")
        for name, c in alike(found).items()
    ]
    return [*mse, *against, *nis]


def apart(found: dict[str, Curves]) -> list[Row]:
    """How far a square root is from its dense form."""
    first = {name: c.test[:, 0] for name, c in alike(found).items()}
    return [
        Row("robot-arm", "largest difference between dense and square root, relative, first epoch", root, None,
            float(np.max(np.abs(first[root] / first[dense] - 1))), None, len(first[root]))
        for dense, root in PAIRS
    ]  # fmt: skip


def gain(found: dict[str, Curves], name: str) -> Mean:
    """How much lower an error ends than that of the EKF, from the same starts."""
    return ahead(found["EKF"].test[:, -1], found[name].test[:, -1])


def claim(found: dict[str, dict[str, Curves]]) -> Claim:
    """That of the papers about the end of the curves."""
    gains = {drift: gain(each, "UKF") for drift, each in found.items()}
    return Claim(
        "the UKF ends slightly lower than the EKF",
        {f"{drift}: lower by {plus_minus(lower, '.1e')}": positive(lower) for drift, lower in gains.items()},
    )


def findings(found: dict[str, dict[str, Curves]]) -> Sequence[str]:
    """What became of the papers' claims, in words."""
    said = [f"No network can be better than the noise, {FLOOR:.4f} per output. The papers print no numbers."]
    for drift, each in found.items():
        means = last(each)
        best, worst = (choose(means, key=lambda name: means[name].value) for choose in (min, max))
        first, second = (gain(each, name) for name in ("UKF", "SR-UKF, option 2"))
        said += [
            f"{drift.capitalize()}: mean errors after {each['EKF'].test.shape[1]} epochs go from "
            f"{means[best].value:.5f} ({best}) to {means[worst].value:.5f} ({worst}).",
            f'"Slightly lower final MSE of the UKF": {decided(first)}. EKF minus UKF on the same starts: '
            f"{first.value:+.1e} ± {first.spread:.0e}.",
            f'"Indistinguishable with option 2": EKF minus SR-UKF with option 2 is {second.value:+.1e} '
            f"± {second.spread:.0e}.",
        ]
    return said
