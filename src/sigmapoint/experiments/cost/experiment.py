"""What an update costs against the number of weights: the square-root filters and the EKF L², the plain UKF L³.

The robot arm's network with a growing hidden layer. Published as curves of floating-point operations per epoch without
numbers: van der Merwe & Wan (2001), Figure 4; ESANN (2001), Figure 3. Here operations are XLA's own count, and times
beside them. Both have terms of lower order in L (the function at each of 2L+1 points is O(L) too), so exponents are
fitted over large L.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from matplotlib.figure import Figure

import sigmapoint as sp
from sigmapoint.experiments.cost.operations import operations
from sigmapoint.experiments.learning.figures import COLOURS
from sigmapoint.experiments.publishing.results import Claim, Mean, Picture, Row, mean_of, publish
from sigmapoint.learning.learner import Learner
from sigmapoint.learning.update import updated
from sigmapoint.methods import Method
from sigmapoint.problems import network, robot_arm
from sigmapoint.timing import clocked

METHODS: dict[str, tuple[Method, float]] = {
    "EKF": (sp.srekf(), 2.0),
    "SR-UKF": (sp.srukf(), 2.0),
    "SR-CDKF": (sp.srcdkf(), 2.0),
    "UKF": (sp.ukf(), 3.0),
}
"""each with the exponent that the papers give"""
HIDDEN, QUICK_HIDDEN = (12, 100, 200, 400, 800), (4, 12)
"""units of the hidden layer; the first is the robot arm's own and not in the fits"""
RUNS, QUICK_RUNS = 7, 2
SECONDS = 0.2
"""about what one timing takes: as many updates as go into it"""
PAIRS = 100
"""different pairs"""


class Cost(NamedTuple):
    """Of an update with each number of weights."""

    weights: Any
    operations: Any
    seconds: np.ndarray
    """one row a repetition"""


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    with jax.enable_x64(True):
        found = measured(QUICK_HIDDEN if quick else HIDDEN, runs or (QUICK_RUNS if quick else RUNS), seed)
    return publish(
        out,
        "The cost of learning: operations and time against the number of weights",
        claim(found),
        findings(found),
        rows(found),
        [Picture("cost", "Operations (counted by XLA) and time of one update; dots are medians.", figure(found))],
    )


def measured(hidden: Sequence[int], repetitions: int, seed: int) -> dict[str, Cost]:
    """Every method at every size, repetitions of all methods in turn."""
    costs: list[dict[str, Cost]] = []
    for units in hidden:
        timed = {name: _prepared(method, units, seed) for name, (method, _) in METHODS.items()}
        taken = [{name: one.seconds() for name, one in timed.items()} for _ in range(repetitions)]
        costs.append(
            {
                name: Cost(5 * units + 2, one.operations(), np.array([each[name] for each in taken]))
                for name, one in timed.items()
            }
        )
    return {name: Cost(*(np.stack(part, axis=-1) for part in zip(*(each[name] for each in costs)))) for name in METHODS}


class Timed(NamedTuple):
    """What is timed: `updates` updates of a learner, the pairs in turn."""

    learner: Learner
    x: Array
    d: Array
    updates: int

    def seconds(self) -> float:
        """An update takes."""
        state = jax.block_until_ready(self.learner.init())
        times = jnp.asarray(self.updates)
        return clocked(lambda: _updated(self.learner, state, self.x, self.d, times))[1] / self.updates

    def operations(self) -> float:
        """Of one update."""
        return operations(partial(updated, self.learner.setup), self.learner.init(), self.x[:1], self.d[:1])


def _prepared(method: Method, units: int, seed: int) -> Timed:
    """As many updates as take about `SECONDS`."""
    w = network.started((2, units, 2), jax.random.key(seed))
    learner = sp.learner(network.network, w, noise=robot_arm.NOISE**2, method=method, drift=sp.fixed(1e-6))
    one = Timed(learner, *robot_arm.drawn(PAIRS, jax.random.key(seed + 1)), 1)
    one.seconds()
    return one._replace(updates=max(1, int(SECONDS / one.seconds())))


@eqx.filter_jit
def _updated(learner: Learner, state: Any, x: Array, d: Array, times: Array) -> Any:
    def once(i: Array, state: Any) -> Any:
        pair = jax.tree.map(lambda a: a[i % PAIRS][None], (x, d))
        return updated(learner.setup, state, *pair)[0]

    return jax.lax.fori_loop(0, times, once, state)


def exponents(cost: Cost) -> tuple[float, Mean]:
    """Fitted over all sizes but the first: of operations, and of time over the repetitions."""
    size = np.log(cost.weights[1:] if len(cost.weights) > 2 else cost.weights)
    last = len(size)

    def slope(values: np.ndarray) -> float:
        return float(np.polyfit(size, np.log(values[-last:]), 1)[0])

    return slope(cost.operations), mean_of(np.array([slope(each) for each in cost.seconds]))


def rows(found: dict[str, Cost]) -> list[Row]:
    """The numbers."""
    fitted = {name: exponents(cost) for name, cost in found.items()}
    runs = len(next(iter(found.values())).seconds)
    operations = [
        Row("cost", "exponent of operations against L", name, METHODS[name][1], count, None, 1, "counted by XLA")
        for name, (count, _) in fitted.items()
    ]
    times = [
        Row("cost", "exponent of time against L", name, METHODS[name][1], mean.value, mean.spread, mean.runs)
        for name, (_, mean) in fitted.items()
    ]
    each = [
        Row("cost", f"time of an update, L = {L:,} [ms]", name, None, float(np.median(cost.seconds[:, i])) * 1e3,
            None, runs, "median")
        for i, L in enumerate(next(iter(found.values())).weights)
        for name, cost in found.items()
    ]  # fmt: skip
    return [*operations, *times, *each]


def claim(found: dict[str, Cost]) -> Claim:
    """That of the papers."""
    counted = {name: exponents(cost)[0] for name, cost in found.items()}
    return Claim(
        "square-root filters cost O(L²), as the EKF; the plain UKF O(L³)",
        {
            f"{name} L^{count:.2f}": count < 2.1 if METHODS[name][1] == 2 else count > 2.5
            for name, count in counted.items()
        },
    )


def findings(found: dict[str, Cost]) -> Sequence[str]:
    """What became of the papers' claims, in words."""
    fitted = {name: exponents(cost) for name, cost in found.items()}
    range_of = next(iter(found.values())).weights
    said = ", ".join(f"{name} L^{count:.2f} (time L^{mean.value:.2f})" for name, (count, mean) in fitted.items())
    small = {name: float(np.median(cost.seconds[:, 0])) for name, cost in found.items()}
    return (
        f"Operations of one update, fitted up to {range_of[-1]:,} weights: {said}.",
        f"At {range_of[0]} weights an update of the SR-UKF takes {small['SR-UKF'] / small['EKF']:.2f} times as long as "
        "the EKF's, which has derivatives.",
    )


def figure(found: dict[str, Cost]) -> Figure:
    """Operations and times against L, both on logarithmic axes."""
    drawn = Figure(figsize=(10, 4.5), layout="constrained")
    counts, times = drawn.subplots(1, 2)
    for colour, (name, cost) in zip(COLOURS, found.items()):
        for axis, values in ((counts, cost.operations), (times, np.median(cost.seconds, axis=0))):
            axis.loglog(cost.weights, values, "o-", color=colour, label=name, lw=1.5, ms=4)
    for axis, what in ((counts, "operations of an update"), (times, "time of an update [s]")):
        axis.set_xlabel("weights L")
        axis.set_ylabel(what)
        axis.spines[["top", "right"]].set_visible(False)
        axis.grid(alpha=0.3)
    counts.legend(frameon=False)
    return drawn
