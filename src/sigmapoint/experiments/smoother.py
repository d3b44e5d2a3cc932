"""Smoothers of two noisy chaotic series, with networks for the dynamics forward and backward.

Source: Wan & van der Merwe (2001), section 7.3.2 and its table: forward (F), backward (B) and smoothed (S) normalised
mean squared errors on Mackey-Glass with a delay of 30, and on a chaotic autoregressive network, both at about 3 dB. The
networks are trained on the clean series. EKS1 linearises the forward model backward, EKS2 has an extended Kalman filter
on a backward network, UKS the unscented one. Lengths and settings are not given; ours: series of 300 samples, networks
trained on 1000, the backward filter starting from the series' stationary distribution.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.figure import Figure

import sigmapoint as sp
from sigmapoint import affine
from sigmapoint.belief import SquareRoot
from sigmapoint.experiments.learning_figures import COLOURS
from sigmapoint.experiments.results import Mean, Picture, Row, decided, mean_of, publish
from sigmapoint.filtering import scan
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel
from sigmapoint.problems import mackey_glass, network, noisy_series
from sigmapoint.problems.autoregression import normalized, pairs
from sigmapoint.step import Filter
from sigmapoint.two_filter import Backward, informed

RUNS, QUICK_RUNS = 20, 2
TRAIN, TEST = 1000, 300
EPOCHS, QUICK_EPOCHS = 20, 3
NOISE = 10**-0.3
"""Variance of the measurement noise, at 3 dB, of a series of variance 1."""
ENDS = 10
"""Samples at either end that no filter is judged by: neither has seen enough there."""
LEAST = 1e-6
"""Information beside that of a backward filter, which has none of some directions at first."""
F, B, S = "forward (F)", "backward (B)", "smoothed (S)"


class Task(NamedTuple):
    """A series, the network that predicts it, and the papers' numbers."""

    name: str
    sizes: tuple[int, int, int]
    prior_std: float
    published: Mapping[str, tuple[float, float, float]]


TASKS = (
    Task(
        "Mackey-Glass",
        (6, 10, 1),
        0.5,
        {"EKS1": (0.20, 0.70, 0.27), "EKS2": (0.20, 0.31, 0.19), "UKS": (0.10, 0.24, 0.08)},
    ),
    Task(
        "AR network",
        (5, 3, 1),
        1.0,
        {"EKS1": (0.35, 0.32, 0.28), "EKS2": (0.35, 0.22, 0.23), "UKS": (0.23, 0.21, 0.16)},
    ),
)
Errors: TypeAlias = Mapping[str, Mapping[str, Float[np.ndarray, " R"]]]
"""by smoother and stage, of every run"""


class Networks(NamedTuple):
    """Weights forward and backward, and the variances of what they leave."""

    forward: Any
    backward: Any
    left: tuple[Array, Array]


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    runs, epochs = runs or (QUICK_RUNS if quick else RUNS), QUICK_EPOCHS if quick else EPOCHS
    with jax.enable_x64(True):
        keys = jax.random.split(jax.random.key(seed), len(TASKS))
        found = {task.name: measured(task, runs, epochs, key) for task, key in zip(TASKS, keys)}
    said = (
        f"Mean over {runs} noisy series of {TEST} samples ± standard error; 1 is an estimate of zero. Grey: published."
    )
    pictures = [
        Picture("smoother", f"Normalised mean squared errors, forward, backward, smoothed. {said}", drawn(found))
    ]
    rows = [row for task in TASKS for row in rows_of(task, found[task.name])]
    return publish(out, "Smoothers of noisy chaotic series", findings(found), rows, pictures)


def smoothers(nets: Networks, initial: sp.Gaussian) -> dict[str, tuple[Method, Any]]:
    """Each by its name: the papers' three, and more."""
    back = noisy_series.backward(nets.backward, nets.left[1], initial)
    return {
        "EKS1": (sp.ekf(), sp.two_filter()),
        "EKS2": (sp.ekf(), back),
        "UKS": (sp.ukf(), back),
        "SR-UKS": (sp.srukf(), back),
        "SR-CDKS": (sp.srcdkf(), back),
        "UKS, linearised backward": (sp.ukf(), sp.two_filter()),
        "EKF, RTS": (sp.ekf(), sp.rts()),
        "UKF, RTS": (sp.ukf(), sp.rts()),
        "SR-CDKF, RTS": (sp.srcdkf(), sp.rts()),
        "SR-CDKF, iterated": (sp.srcdkf(), sp.ipls(5)),
    }


def measured(task: Task, runs: int, epochs: int, key: Array, only: Sequence[str] | None = None) -> Errors:
    """The errors of all smoothers, each run on another series with other noise (Mackey-Glass: another part of it)."""
    order, kept = task.sizes[0], []
    parts = jax.random.split(key, runs)
    whole = normalized(mackey_glass.series(TRAIN + runs * TEST)) if task.name == "Mackey-Glass" else None
    nets = None if whole is None else trained(task, whole[:TRAIN], epochs, key)
    for r, part in enumerate(parts):
        if whole is None:
            series = normalized(noisy_series.drawn(TRAIN + TEST, part))
            nets, clean, test = trained(task, series[:TRAIN], epochs, part), series[:TRAIN], series[TRAIN:]
        else:
            clean, test = whole[:TRAIN], whole[TRAIN + r * TEST : TRAIN + (r + 1) * TEST]
        y = test + NOISE**0.5 * jax.random.normal(jax.random.fold_in(part, 1), test.shape)
        initial = noisy_series.stationary(clean, order)
        assert nets is not None
        model = noisy_series.model(nets.forward, nets.left[0], jnp.asarray(NOISE), initial)
        kept.append({name: errors(model, y[:, None], test, *each) for name, each in smoothers(nets, initial).items()})
    return {
        name: {stage: np.array([float(one[name][stage]) for one in kept]) for stage in kept[0][name]}
        for name in kept[0]
    }


def trained(task: Task, clean: Float[Array, " T"], epochs: int, key: Array) -> Networks:
    """Networks that predict the next sample, and the one before."""
    found = []
    for series, k in zip((clean, clean[::-1]), jax.random.split(key)):
        x, d = pairs(series, task.sizes[0])
        fit = sp.learn(
            network.network, network.started(task.sizes, k), x, d,
            noise=1e-3, drift=sp.annealed(1e-4, 0.999, 1e-9), prior_std=task.prior_std, epochs=epochs, key=k,
        )  # fmt: skip
        left = jax.vmap(lambda x, w=fit.params: network.network(w, x))(x) - d
        found.append((fit.params, jnp.mean(left**2)))
    (forward, ahead), (backward, behind) = found
    return Networks(forward, backward, (ahead, behind))


@eqx.filter_jit
def errors(
    model: StateSpaceModel, y: Float[Array, "T 1"], x: Float[Array, " T"], method: Method, smoother: Any
) -> dict[str, Float[Array, ""]]:
    """Normalised mean squared errors of the newest sample in the state."""
    run = Filter.of(model, method)
    forward = scan(run, y, None, lambda state, _: state.belief)[0]
    means = {F: forward.mean, S: smoother(run, y, None, ("mean",))["mean"]}
    if isinstance(smoother, Backward):
        means[B] = smoother.filtered(run, y, None)[1].mean
    elif smoother == sp.two_filter():
        means[B] = _linearised_backward(run, forward, y)
    inside = slice(ENDS, -ENDS)
    return {stage: jnp.mean((mean[inside, 0] - x[inside]) ** 2) / jnp.var(x) for stage, mean in means.items()}


def _linearised_backward(run: Filter, forward: Any, y: Array) -> Float[Array, "T p"]:
    """What the backward filter of the linearised model says with the measurement of the instant itself."""
    model = affine.linearized(run, jax.vmap(lambda b: SquareRoot(b.mean, b.factor))(forward), y, None)
    later = informed(model)

    def at(mean: Array, eta: Array, Z: Array, H: Array, r: Array) -> Array:
        information = Z @ Z.T + H.T @ H / NOISE + LEAST * jnp.eye(len(mean))
        return mean + jnp.linalg.solve(information, eta + H.T @ r / NOISE)

    return jax.vmap(at)(forward.mean, later.eta, later.Z, model.H, model.r)


def rows_of(task: Task, found: Errors) -> list[Row]:
    """The numbers of one series, stage by stage."""
    return [
        Row("smoother", f"{task.name}: normalised MSE, {stage}", name, published, mean.value, mean.spread, mean.runs)
        for i, stage in enumerate((F, B, S))
        for name, stages in found.items()
        if stage in stages
        for mean in (mean_of(stages[stage]),)
        for published in (task.published[name][i] if name in task.published else None,)
    ]


def gain(found: Errors, worse: tuple[str, str], better: tuple[str, str]) -> Mean:
    """How much lower one error is than another, run by run."""
    return mean_of(found[worse[0]][worse[1]] - found[better[0]][better[1]])


def findings(found: Mapping[str, Errors]) -> Sequence[str]:
    """What became of the claims, in words."""
    said = []
    for name, each in found.items():
        less = partial(gain, each)
        claims = {
            "UKS smoothed below its own forward filter": less(("UKS", F), ("UKS", S)),
            "UKS below EKS1, smoothed": less(("EKS1", S), ("UKS", S)),
            "UKS below EKS2, smoothed": less(("EKS2", S), ("UKS", S)),
            "the unscented filter below the extended one, forward": less(("EKS1", F), ("UKS", F)),
        }
        if "UKF, RTS" in each:
            claims["Rauch-Tung-Striebel by the unscented filter below UKS"] = less(("UKS", S), ("UKF, RTS", S))
        said += [
            f"{name}: {claim}: {decided(mean)} (by {mean.value:.3f} ± {mean.spread:.3f})."
            for claim, mean in claims.items()
        ]
    return said


def drawn(found: Mapping[str, Errors]) -> Figure:
    """Errors by stage, the papers' behind them."""
    figure = Figure(figsize=(11, 4.5), layout="constrained")
    tasks = [task for task in TASKS if task.name in found]
    axes = figure.subplots(1, len(tasks), squeeze=False)[0]
    for axis, task in zip(axes, tasks):
        each = found[task.name]
        names = list(each)
        for i, stage in enumerate((F, B, S)):
            at = [k for k, name in enumerate(names) if stage in each[name]]
            means = [mean_of(each[names[k]][stage]) for k in at]
            place = np.array(at) + 0.25 * (i - 1)
            axis.bar(
                place, [m.value for m in means], 0.22, yerr=[m.spread for m in means], color=COLOURS[i], label=stage
            )
            for k, name in enumerate(names):
                if name in task.published:
                    axis.plot(
                        k + 0.25 * (i - 1) + np.array([-0.13, 0.13]), [task.published[name][i]] * 2, c="0.35", lw=2
                    )
        axis.set_xticks(range(len(names)), names, rotation=35, ha="right")
        axis.set_title(task.name)
        axis.set_ylabel("normalised mean squared error")
        axis.spines[["top", "right"]].set_visible(False)
        axis.set_ylim(0, min(1, axis.get_ylim()[1]))
    axes[-1].legend(frameon=False)
    return figure
