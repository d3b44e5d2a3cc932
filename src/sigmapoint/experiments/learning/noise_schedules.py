"""A network learns the next sample of a chaotic series: four choices of process noise, by several filters.

Source: Wan & van der Merwe (2001), section 7.4, Figures 7.8 bottom and 7.9, curves without numbers: "the Robbins-Monro
method provides the fastest rate of absolute convergence and lowest final MMSE values", for a UKF with α = 1e-4, β = 2,
κ = 3 − L; and that annealing, which was faster "in some examples", asks for more knowledge of the noise. Neither the
lengths of the series nor any settings of the noises are given; ours are those of each `Task`, each noise at its best
as far as a few runs a setting tell: 0.03 in the logarithm is within what other settings give.

Runs differ in the series, the start of the network and the order of the samples. Errors differ by large factors between
them: filters and noises are compared in the same runs, by log10 of a ratio.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import jax
import numpy as np
from jaxtyping import Array, Float
from matplotlib.figure import Figure

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
from sigmapoint.problems import network
from sigmapoint.problems.autoregression import normalized, pairs

RUNS = Runs(each=10, compared=40, quick=2)
EPOCHS, QUICK_EPOCHS = 20, 2
TRAIN, TEST = 500, 500
UKF, ROBBINS_MONRO = "SR-UKF", "Robbins-Monro"
METHODS = (UKF, AT_MEAN := f"{UKF}, option 2", "EKF", "SR-CDKF")
COMPARED = (UKF, "EKF")
"""by the papers' statements: the noises by the former, and the two with each other"""

Found: TypeAlias = Mapping[tuple[str, str], Curves]
"""by filter and process noise"""
Measure: TypeAlias = Callable[[Curves], Float[np.ndarray, " R"]]
"""one number a run"""


class Task(NamedTuple):
    """A series, a network with one hidden layer, and what the filters are told."""

    name: str
    title: str
    series: Callable[[int, Array], Float[Array, " T"]]
    """(samples, key); normalised here"""
    sizes: tuple[int, int, int]
    """units of the network, samples it sees first"""
    noise: float
    """variance of a target; the series has 1"""
    prior_std: float
    drifts: Mapping[str, Drift]
    """the process noises"""


def methods(weights: int) -> dict[str, Method]:
    """The filters, for so many weights."""
    ukf = sp.srukf(alpha=1e-4, beta=2.0, kappa=3.0 - weights)
    return dict(zip(METHODS, (ukf, sp.at_mean(ukf), sp.ekf(), sp.srcdkf())))


def run(task: Task, runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    with jax.enable_x64(True):
        counts = RUNS.of(METHODS, COMPARED, runs, quick)
        epochs, whole = (QUICK_EPOCHS, (UKF,)) if quick else (EPOCHS, (UKF, "EKF", "SR-CDKF"))
        found = trained(task, counts, epochs, whole, jax.random.key(seed))
    noises = {noise: found[UKF, noise] for noise in task.drifts}
    filters = alike({method: c for (method, noise), c in found.items() if noise == ROBBINS_MONRO})

    def said(shown: Mapping[str, Curves]) -> str:
        runs = len(next(iter(shown.values())).test)
        each = f"Error on {TEST} test samples after each epoch of {TRAIN}"
        return f"{each}, mean over the same {runs} runs ± standard error"

    pictures = [
        Picture(
            f"{task.name}-noise", f"As Figure 7.9: {UKF}, four choices of process noise. {said(noises)}.", drawn(noises)
        ),
        Picture(
            f"{task.name}-filters", f"As Figure 7.8: {ROBBINS_MONRO}, several filters. {said(filters)}.", drawn(filters)
        ),
    ]
    return publish(out, task.title, claim(found), findings(found), rows(task, found), pictures)


def trained(task: Task, counts: Mapping[str, int], epochs: int, whole: Sequence[str], key: Array) -> Found:
    """Each filter in so many of the same runs, with a series, a start and orders each: all filters with Robbins-Monro,
    and the `whole` ones with every process noise."""
    runs, keys, past = max(counts.values()), jax.random.split(key, 3), task.sizes[0]
    series = jax.vmap(lambda k: pairs(normalized(task.series(past + TRAIN + TEST, k)), past))
    starts = network.starts(task.sizes, runs, keys[1])
    train, lessons = taught(series(jax.random.split(keys[0], runs)), TRAIN, starts, epochs, keys[2])
    return {
        (name, noise): curves(learner(task, method, drift), first(lessons, counts[name]), train)
        for name, method in methods(starts.shape[1]).items()
        for noise, drift in task.drifts.items()
        if noise == ROBBINS_MONRO or name in whole
    }


def learner(task: Task, method: Method, drift: Drift) -> Learner:
    """The network before it has seen anything."""
    start = network.started(task.sizes, jax.random.key(0))
    return sp.learner(network.network, start, noise=task.noise, method=method, drift=drift, prior_std=task.prior_std)


def drawn(found: Mapping[str, Curves]) -> Figure:
    """Learning curves."""
    return learning({name: c.test for name, c in found.items()}, None, "mean squared error, test set (1: predicts 0)")


def last(found: Curves) -> Float[np.ndarray, " R"]:
    """log10 of the error after the last epoch."""
    return np.log10(found.test[:, -1])


def height(found: Curves) -> Float[np.ndarray, " R"]:
    """log10 of the error, mean over all epochs: low where learning is fast."""
    return np.log10(found.test).mean(1)


MEASURES = {"log10 MSE after the last epoch": last, "log10 MSE, mean over epochs": height}
CLAIMS = {"lowest in the end": last, "fastest (mean over epochs)": height}


def above(found: Found, measure: Measure, this: tuple[str, str], that: tuple[str, str]) -> Mean:
    """How much higher this is than that, in the same runs."""
    return ahead(measure(found[this]), measure(found[that]))


def rivals(found: Found, measure: Measure, method: str) -> dict[str, Mean]:
    """How much higher the other process noises are than Robbins-Monro, by one filter."""
    best = (method, ROBBINS_MONRO)
    return {key[1]: above(found, measure, key, best) for key in found if key[0] == method and key != best}


def others(found: Found, measure: Measure) -> dict[str, Mean]:
    """How much higher the other filters are than the UKF, with Robbins-Monro."""
    best = (UKF, ROBBINS_MONRO)
    return {key[0]: above(found, measure, key, best) for key in found if key[1] == ROBBINS_MONRO and key != best}


def rows(task: Task, found: Found) -> list[Row]:
    """The numbers."""

    row = partial(row_of, task.name)
    filters, same = dict.fromkeys(name for name, _ in found), alike(found)
    return [
        *(row("test MSE after the last epoch", f"{name}, {noise}", mean_of(c.test[:, -1]), repr(task.drifts[noise]))
          for (name, noise), c in same.items()),
        *(row(f"{what}, above {ROBBINS_MONRO} in the same runs", f"{name}, {noise}", mean)
          for what, measure in MEASURES.items() for name in filters
          for noise, mean in rivals(found, measure, name).items()),
        *(row(f"{what}, above the {UKF} in the same runs", f"{name}, {ROBBINS_MONRO}", mean)
          for what, measure in MEASURES.items() for name, mean in others(found, measure).items()),
        *(row("NIS in the last epoch", ", ".join(key), mean_of(c.nis[:, -1])) for key, c in same.items()),
    ]  # fmt: skip


def claim(found: Found) -> Claim:
    """That of the papers about the process noise."""
    return Claim(
        f"{ROBBINS_MONRO} is the fastest process noise, and ends lowest",
        {
            f"{what} against {name} by {plus_minus(gain)} (log10)": positive(gain)
            for what, measure in CLAIMS.items()
            for name, gain in rivals(found, measure, UKF).items()
        },
    )


def findings(found: Found) -> Sequence[str]:
    """What became of the papers' claims, in words."""
    ekf = others(found, last)["EKF"]
    second = above(found, last, (AT_MEAN, ROBBINS_MONRO), ("EKF", ROBBINS_MONRO))
    return (
        "The papers show curves and print no numbers. Compared is log10 of the ratio of two errors in the same runs, "
        "± its standard error: +0.3 is twice the error.",
        *(
            f"{ROBBINS_MONRO} {claim}, {UKF}: {verdict(gains)}. The others minus it: {_listed(gains)}."
            for claim, measure in CLAIMS.items()
            for gains in (rivals(found, measure, UKF),)
        ),
        *(
            f'"Differences are similar" with the {name}: lowest {verdict(rivals(found, last, name))}, fastest '
            f"{verdict(rivals(found, height, name))}. In the end, minus it: {_listed(rivals(found, last, name))}."
            for name in others(found, last)
            if rivals(found, last, name)
        ),
        f'"Slightly lower final MSE of the UKF" than of the EKF: {decided(ekf)}. The others minus the '
        f"{UKF} in the end, {ROBBINS_MONRO}: {_listed(others(found, last))}.",
        f'"Indistinguishable with option 2": minus the EKF it is {second.value:+.3f} ± {second.spread:.3f} in the end.',
    )


def verdict(gains: Mapping[str, Mean]) -> str:
    """What became of the claim that all of these are positive."""
    each = {name: decided(gain) for name, gain in gains.items()}
    if "contradicted" in each.values():
        return f"contradicted by {' and '.join(name for name, said in each.items() if said == 'contradicted')}"
    return "reproduced" if set(each.values()) == {"reproduced"} else "not decided by these runs"


def _listed(gains: Mapping[str, Mean]) -> str:
    return ", ".join(f"{name} {gain.value:+.3f} ± {gain.spread:.3f}" for name, gain in gains.items())
