"""Training a 2-12-2 network on MacKay's robot arm: extended against sigma-point filters, dense against square root.

Published as learning curves without numbers: Wan & van der Merwe (2001), Figure 7.8 top, "note the slightly lower final
MSE performance of the UKF weight training" (predicting by the mean of the outputs; by the output at the mean the curves
are said to be indistinguishable); van der Merwe & Wan (2001), Figure 2: square-root forms learn as the plain ones do.
The process noise is annealed and added to the diagonal, as there (without their settings), and once more a forgetting
factor, with which both forms are the same filter. The claim is about the former. Settings are those with the lowest
error in the end on other data: of the prior, .2 to 2, for all; of annealing, for the EKF and for the UKF, which the
other filters share (seed 103, 30 runs with data of their own: from 1e-6 to 1e-3 by .995 to .9995; for the EKF, whose
best were the highest of these, to 1e-1 and from .99). Started so high, the UKF spends its first epochs on coming back.
A forgetting factor of .998 was as good for the EKF (.00311, annealed .00310), but with it one UKF in thirty ended with
errors beyond all others (annealed: .00303); here it is .999.

The noise has a standard deviation of 0.05, so no network gets below 0.0025 per output.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np

import sigmapoint as sp
from sigmapoint.experiments.learning.curves import Curves, curves, taught
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
from sigmapoint.experiments.runs import Runs, alike, first
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
PUBLISHED, EXACT = "annealed", "forgetting"
"""process noises: that of the claim, and one with which both forms are the same filter"""
AS_EKF = ("EKF", "SR-UKF, option 2")
"""methods with the settings of the EKF"""
PRIOR = 0.3
QUOTED = {"UKF": "Slightly lower final MSE of the UKF", "SR-UKF, option 2": "Indistinguishable with option 2"}
COMPARED = ("EKF", "UKF")
"""by the claim"""
RUNS = {PUBLISHED: Runs(each=10, compared=300, quick=2), EXACT: Runs(each=10, compared=100, quick=2)}
LOOKED_AT = (
    "The number of runs with annealed noise was raised to 300 after the first 100 of them had not decided "
    "(8.0e-5 ± 3.0e-5): two looks are more likely to find something by chance than one."
)
EPOCHS, QUICK_EPOCHS = 40, 5
TRAIN, TEST = 200, 2000
FLOOR = robot_arm.NOISE**2
PAIRS = (("UKF", "SR-UKF"), ("CDKF", "SR-CDKF"))


_row = partial(row_of, "robot-arm")


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    with jax.enable_x64(True):
        epochs = QUICK_EPOCHS if quick else EPOCHS
        found = {
            kind: trained(kind, RUNS[kind].of(names, COMPARED, runs, quick), epochs, jax.random.key(seed))
            for kind, names in ((PUBLISHED, COMPARED if quick else METHODS), (EXACT, METHODS))
        }
    caption = f"test set of {TEST} rows after each epoch of {TRAIN}, mean over the same runs ± standard error."
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


def trained(kind: str, counts: Mapping[str, int], epochs: int, key: Any) -> dict[str, Curves]:
    """Methods with a kind of process noise, each in so many of the same runs: with data, a start and an order each."""
    keys, runs = jax.random.split(key, 3), max(counts.values())
    pairs = jax.vmap(lambda k: robot_arm.drawn(TRAIN + TEST, k))(jax.random.split(keys[0], runs))
    train, lessons = taught(pairs, TRAIN, network.starts(SIZES, runs, keys[1]), epochs, keys[2])
    return {
        name: curves(learner(METHODS[name][0], drift(kind, name)), first(lessons, count), train)
        for name, count in counts.items()
    }


def drift(kind: str, name: str) -> Drift:
    """The process noise of a method."""
    if kind == EXACT:
        return sp.forgetting(0.999)
    start, rate = (3e-2, 0.997) if name in AS_EKF else (3e-4, 0.998)
    return sp.on_diagonal(sp.annealed(start, rate, floor=1e-9))


def learner(method: Method, drift: Drift) -> Learner:
    """The network before it has seen anything."""
    start = network.started(SIZES, jax.random.key(0))
    return sp.learner(network.network, start, noise=FLOOR, method=method, drift=drift, prior_std=PRIOR)


def last(found: dict[str, Curves]) -> dict[str, Mean]:
    """Mean errors after the last epoch, on the runs that all have."""
    return {name: mean_of(c.test[:, -1]) for name, c in alike(found).items()}


def rows(kind: str, found: dict[str, Curves]) -> list[Row]:
    """The numbers with one kind of process noise."""
    mse = [
        _row(f"{kind}: test MSE per output after the last epoch", name, mean, METHODS[name][1])
        for name, mean in last(found).items()
    ]
    against = [
        _row(f"{kind}: the same, difference to the EKF", name, ahead(c.test[:, -1], found["EKF"].test[:, -1]), "")
        for name, c in found.items()
        if name != "EKF"
    ]
    nis = [
        _row(f"{kind}: NIS per output in the last epoch", name, mean_of(c.nis[:, -1]), "")
        for name, c in alike(found).items()
    ]
    return [*mse, *against, *nis]


def apart(found: dict[str, Curves]) -> list[Row]:
    """How far a square root is from its dense form."""
    early = {name: c.test[:, 0] for name, c in alike(found).items()}
    return [
        Row("robot-arm", "largest difference between dense and square root, relative, first epoch", root, None,
            float(np.max(np.abs(early[root] / early[dense] - 1))), None, len(early[root]))
        for dense, root in PAIRS
    ]  # fmt: skip


def gain(found: dict[str, Curves], name: str) -> Mean:
    """How much lower an error ends than that of the EKF, in the same runs."""
    return ahead(found["EKF"].test[:, -1], found[name].test[:, -1])


def claim(found: dict[str, dict[str, Curves]]) -> Claim:
    """That of the papers about the end of the curves."""
    lower = gain(found[PUBLISHED], "UKF")
    return Claim(
        "the UKF ends slightly lower than the EKF",
        {
            f"{PUBLISHED} noise, each with the best tried: lower by {plus_minus(lower, '.1e')} (with one forgetting "
            f"factor for both, by {plus_minus(gain(found[EXACT], 'UKF'), '.1e')})": positive(lower)
        },
    )


def findings(found: dict[str, dict[str, Curves]]) -> Sequence[str]:
    """What became of the papers' claims, in words."""
    said = [
        f"No network can be better than the noise, {FLOOR:.4f} per output. The papers print no numbers. {LOOKED_AT}"
    ]
    for kind, each in found.items():
        means = last(each)
        best, worst = (choose(means, key=lambda name: means[name].value) for choose in (min, max))
        lower = {name: gain(each, name) for name in QUOTED if name in each}
        said += [
            f"{kind.capitalize()}: mean errors after {each['EKF'].test.shape[1]} epochs go from "
            f"{means[best].value:.5f} ({best}) to {means[worst].value:.5f} ({worst}).",
            *(f'"{QUOTED[name]}": EKF minus {name} in the same runs is {mean.value:+.1e} ± {mean.spread:.0e}'
              f"{', ' + decided(mean) if name == COMPARED[1] else ''}."
              for name, mean in lower.items()),
        ]  # fmt: skip
    return said
