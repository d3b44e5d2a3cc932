"""Clean series and network from the noisy series alone: dual and joint estimation, and expectation-maximisation.

Source: Wan & van der Merwe (2001), section 7.5.1, Figure 7.13, curves without numbers: "the superior performance of the
UKF based algorithms are clear". Noise variances are known; the drift of the weights is fixed in the joint filters and
annealed in the dual ones. What the drifts are, how long the series and how many epochs is not given; ours are in
`dual.runs` and in each `Task`.

Runs differ in the series, the noise and the start of the network. Methods are compared on the same runs.
"""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

import sigmapoint as sp
from sigmapoint.experiments.dual.runs import Curve, Epochs, Series, curve, known
from sigmapoint.experiments.learning.figures import COLOURS
from sigmapoint.experiments.publishing.results import (
    Claim,
    Mean,
    Picture,
    Row,
    ahead,
    decided,
    mean_of,
    positive,
    publish,
    row_of,
)
from sigmapoint.experiments.runs import Runs, alike, first
from sigmapoint.problems.noisy_series import NOISE

QUICK_EPOCHS, QUICK_SAMPLES = 2, 200
PART = 100
"""Samples in a picture."""
REACHED = "SR-UKF, weights known"
KINDS = ("dual", "joint")

Found: TypeAlias = Mapping[str, Curve]
"""by method"""


class Task(NamedTuple):
    """A series, and what is tried on it."""

    name: str
    title: str
    series: Callable[[int, int, Array], Series]
    """(runs, samples, key)"""
    runs: Runs
    samples: int
    epochs: int
    methods: Mapping[str, Epochs]
    """by a name that begins with the kind"""
    claims: Mapping[str, tuple[str, str]]
    """which is said to be better than which, by kind"""
    quick: tuple[str, ...]
    """methods of a quick run"""
    shown: str
    """method whose estimate is in a picture"""


def run(task: Task, runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    names, epochs = task.quick if quick else tuple(task.methods), QUICK_EPOCHS if quick else task.epochs
    compared = [name for pair in task.claims.values() for name in pair]
    counts = task.runs.of(names, compared, runs, quick)
    with jax.enable_x64(True):
        series = task.series(max(counts.values()), QUICK_SAMPLES if quick else task.samples, jax.random.key(seed))
        found = {name: curve(task.methods[name], first(series, count), epochs) for name, count in counts.items()}
        reached = curve(known(sp.srukf()), series, 1)
    same = alike({**found, REACHED: reached})
    shown = task.shown if task.shown in found else next(iter(found))
    samples = series.clean.shape[1]
    pictures = [
        Picture(
            f"{task.name}-curves",
            f"As Figure 7.13: error of the filtered series by epoch of {samples} samples, mean over the same "
            f"{min(counts.values())} runs ± standard error; the noise itself has {NOISE:.2f}. Black: {REACHED}.",
            curves({name: same[name].errors for name in found}, mean_of(same[REACHED].errors[:, -1])),
        ),
        Picture(
            f"{task.name}-estimate",
            f"The last {min(PART, samples)} samples of a run: estimate of the {shown} in the last epoch.",
            estimate(series, found[shown], shown),
        ),
    ]
    return publish(
        out,
        task.title,
        claim(task, found),
        findings(task, found, same, samples),
        rows(task, found, same),
        pictures,
    )


def noisy(clean: Array, key: Array) -> Array:
    """Through noise at 3 dB."""
    return clean + NOISE**0.5 * jax.random.normal(key, clean.shape)


def stacked(runs: list[Series]) -> Series:
    """One record of all runs."""
    return jax.tree.map(lambda *each: jnp.stack(each), *runs)


def gain(found: Found, better: str, worse: str) -> Mean:
    """log10 of how many times lower one error is than the other in the last epoch, on the same runs.

    Few runs with large errors would decide a mean of differences.
    """
    return ahead(*(np.log10(found[name].errors[:, -1]) for name in (worse, better)))


def claimed(task: Task, found: Found) -> dict[str, Mean]:
    """Gains of the better over the worse, as far as both were tried."""
    return {
        f"{better} below {worse}": gain(found, better, worse)
        for better, worse in task.claims.values()
        if better in found and worse in found
    }


def rows(task: Task, found: Found, same: Found) -> list[Row]:
    """The numbers: means over the runs that are the same for all, differences over all that two methods share."""
    row = partial(row_of, task.name)
    return [
        *(row("normalised MSE, last epoch", name, mean_of(c.errors[:, -1])) for name, c in same.items()),
        *(row("normalised MSE, first epoch", name, mean_of(same[name].errors[:, 0])) for name in found),
        *(row("log10 of the ratio of normalised MSE, last epoch, on the same runs", what, mean)
          for what, mean in claimed(task, found).items()),
    ]  # fmt: skip


def claim(task: Task, found: Found) -> Claim:
    """That of the paper."""
    return Claim(
        "superior performance of the UKF over the EKF, dual and joint",
        {f"{what} by {_said(mean)} (log10)": positive(mean) for what, mean in claimed(task, found).items()},
    )


def findings(task: Task, found: Found, same: Found, samples: int) -> list[str]:
    """What became of the claim, in words."""
    ends = ", ".join(f"{name} {_said(mean_of(c.errors[:, -1]))}" for name, c in same.items())
    epochs = next(iter(found.values())).errors.shape[1]
    lost = {name: int(np.sum(~np.isfinite(c.errors[:, -1]))) for name, c in found.items()}
    return [
        "The paper shows curves and prints no numbers.",
        *(f'"Superior performance of the UKF": {what}: {decided(mean)} (log10 of the ratio: {_said(mean)}).'
          for what, mean in claimed(task, found).items()),
        f"Normalised mean squared error in epoch {epochs} of {samples} samples: {ends}; the noise itself {NOISE:.2f}.",
        *(f"{name}: {count} runs without an end are left out." for name, count in lost.items() if count),
    ]  # fmt: skip


def _said(mean: Mean) -> str:
    return f"{mean.value:.3f} ± {mean.spread:.3f}"


def curves(found: Mapping[str, Float[np.ndarray, "R E"]], reached: Mean) -> Figure:
    """Learning curves, a panel for each kind of estimator; the others with the first."""
    figure = Figure(figsize=(11, 4.5), layout="constrained")
    axes = figure.subplots(1, len(KINDS), sharey=True)
    for i, (axis, kind) in enumerate(zip(axes, KINDS)):
        of_kind = [name for name in found if name.startswith(kind) or (i == 0 and not name.startswith(KINDS))]
        for colour, name in zip(COLOURS, of_kind):
            errors = found[name]
            epochs, mean = np.arange(1, errors.shape[1] + 1), errors.mean(0)
            spread = errors.std(0, ddof=1) / len(errors) ** 0.5
            axis.plot(epochs, mean, color=colour, label=name)
            axis.fill_between(epochs, mean - spread, mean + spread, color=colour, alpha=0.15, lw=0)
        axis.axhline(NOISE, color="0.6", lw=0.8, ls=":", label="the noise itself")
        axis.axhline(reached.value, color="black", lw=0.8, ls="--", label="weights known")
        axis.set_yscale("log")
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
        axis.set_xlabel("epoch")
        axis.set_title(kind)
        axis.spines[["top", "right"]].set_visible(False)
        axis.legend(frameon=False, fontsize=8, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.14))
    axes[0].set_ylabel("normalised mean squared error")
    return figure


def estimate(series: Series, found: Curve, name: str) -> Figure:
    """The end of the first run."""
    figure = Figure(figsize=(11, 3.5), layout="constrained")
    axis = figure.subplots()
    last = np.arange(series.clean.shape[1])[-PART:]
    axis.plot(last, np.asarray(series.noisy)[0, last], ".", color="0.6", label="noisy")
    axis.plot(last, np.asarray(series.clean)[0, last], color="black", lw=1, label="clean")
    axis.plot(last, found.estimate[0, last], color=COLOURS[1], label=name)
    axis.set_xlabel("sample")
    axis.spines[["top", "right"]].set_visible(False)
    axis.legend(frameon=False, ncols=3)
    return figure
