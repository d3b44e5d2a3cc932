"""A double inverted pendulum kept upright while its state and its lengths and masses are estimated: adaptive control.

Published (Wan & van der Merwe 2001, section 7.5.1, Figure 7.17), of one run: "at the start of the simulation both the
states and parameters are unknown (the control system is unstable at this point). However, within one trial, the UKF
enables convergence and stabilization of the pendulum without a single crash." It prints neither noise, prior, starts of
the parameters, weights of the controller nor the range of the force: those here are ours (`problems.pendulum_adaptive`,
`problems.pendulum_control`). A trial is a success if no rod passes the horizontal and both are upright within 10° in
the end. Beside it: control with the parameters known, and with everything known, which is the most there is to reach.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import sigmapoint as sp
from sigmapoint.experiments.pendulum_adaptive.figures import converging, successes, tracks
from sigmapoint.experiments.publishing.results import (
    Claim,
    Mean,
    Picture,
    Row,
    ahead,
    decided,
    mean_of,
    publish,
    row_of,
)
from sigmapoint.methods import Method
from sigmapoint.problems import pendulum_adaptive as problem
from sigmapoint.problems.pendulum import STEP, TRUTH, fallen
from sigmapoint.problems.pendulum_adaptive import SENSORS, Control, Start, Trial

UNSCENTED = sp.ukf()


class Way(NamedTuple):
    """A filter, and what the controller is told of it."""

    method: Method
    control: Control
    note: str


WAYS = {
    "UKF": Way(UNSCENTED, problem.adaptive, "α=1, β=2, κ=0"),
    "SR-UKF": Way(sp.srukf(), problem.adaptive, "α=1, β=2, κ=0"),
    "SR-CDKF": Way(sp.srcdkf(), problem.adaptive, "h = √3"),
    "EKF": Way(sp.ekf(), problem.adaptive, ""),
    "parameters known": Way(UNSCENTED, problem.parameters_known, "to the controller only; states by the joint UKF"),
    "all known": Way(UNSCENTED, problem.all_known, "to the controller: true parameters and states"),
}
QUICK_WAYS = ("UKF", "EKF")
SPOKEN = ("UKF", "EKF", "all known")
NOISES = {"noise × 1": 1.0, "noise × 2": 2.0, "noise × 5": 5.0}
"""standard deviations of the measurements, over those of `problems.pendulum_adaptive`"""
BASE = "noise × 1"
RUNS, QUICK_RUNS = 200, 4
STEPS, QUICK_STEPS = 500, 300
UPRIGHT = np.deg2rad(10.0)
"""[rad] both angles, in the end: by the noise of the measurements a pendulum sways"""
WANTED = 0.9
NAMES = ("l1 [m]", "l2 [m]", "m1 [kg]", "m2 [kg]", "M [kg]")


class Outcome(NamedTuple):
    """One number a run, or five."""

    fell: np.ndarray
    success: np.ndarray
    error: Float[np.ndarray, "R 5"]
    """[%] of the parameters in the end; NaN in runs without success"""
    inside: Float[np.ndarray, "R 5"]
    """1 for a parameter in its 95 % interval in the end; NaN in runs without success"""
    when: np.ndarray
    """[s] of the fall; NaN in runs without one"""
    strongest: np.ndarray
    """[N] largest force"""
    furthest: np.ndarray
    """[m] largest distance of the cart"""


_row = partial(row_of, "pendulum-adaptive")


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    ways = {name: WAYS[name] for name in (QUICK_WAYS if quick else WAYS)}
    noises = {BASE: NOISES[BASE]} if quick else NOISES
    with jax.enable_x64(True):
        keys = jax.random.split(jax.random.key(seed))
        count = runs or (QUICK_RUNS if quick else RUNS)
        start, noise = problem.starts(count, keys[0]), jax.random.split(keys[1], count)
        programs = {name: _program(way, QUICK_STEPS if quick else STEPS) for name, way in ways.items()}
        shown = programs["UKF"](start, NOISES[BASE], noise)
        found = {
            level: {name: outcome(program(start, times, noise)) for name, program in programs.items()}
            for level, times in noises.items()
        }
    first = int(np.argmax(found[BASE]["UKF"].success))
    return publish(
        out,
        "A double inverted pendulum, kept upright while its lengths and masses are learned",
        claim(found),
        findings(found),
        rows(found),
        pictures(jax.tree.map(lambda a: a[first], shown), found, np.asarray(start.factors)[first]),
    )


def _program(way: Way, steps: int) -> Callable[[Start, float, Array], Trial]:
    def one(start: Start, sensors: Array, key: Array) -> Trial:
        return problem.trial(way.method, way.control, start, sensors, steps, key)

    program = jax.jit(jax.vmap(one, (0, None, 0)))
    return lambda start, times, keys: jax.tree.map(np.asarray, program(start, jnp.asarray(times * SENSORS), keys))


def outcome(trial: Trial) -> Outcome:
    """What became of each run."""
    down = np.asarray(fallen(trial.state)) | ~np.isfinite(trial.state).all(2)
    fell, when = np.asarray(down.any(1)), STEP * down.argmax(1)
    success = ~fell & (np.abs(trial.state[:, -1][:, [2, 4]]) < UPRIGHT).all(1)
    value, low, high = (
        np.stack(part, axis=-1)[:, -1] for part in (trial.parameters.value, trial.parameters.low, trial.parameters.high)
    )
    kept, truth = np.where(success, 0.0, np.nan)[:, None], np.array(TRUTH)
    inside = 1.0 * ((low <= truth) & (truth <= high))
    return Outcome(
        fell, success, 100 * np.abs(value / truth - 1) + kept, inside + kept, np.where(fell, when, np.nan),
        np.abs(trial.force).max(1) + kept[:, 0], np.abs(trial.state[:, :, 0]).max(1) + kept[:, 0],
    )  # fmt: skip


def rows(found: Mapping[str, Mapping[str, Outcome]]) -> list[Row]:
    """The numbers."""
    base = found[BASE]
    learned = {name: one for name, one in base.items() if WAYS[name].control is problem.adaptive}
    return [
        *(_row(f"share of trials that succeed, {level}", name, mean_of(1.0 * one.success),
               "; ".join(filter(None, (WAYS[name].note, f"{one.fell.sum()} fell"))))
          for level, by in found.items() for name, one in by.items()),
        *(_row(f"success on the same starts, {name} minus EKF", level, gain(by, name))
          for name in learned if name != "EKF" for level, by in found.items()),
        *(_row(f"error of {parameter} in the end, %", name, mean_of(one.error[:, i]), "of the trials that succeed")
          for i, parameter in enumerate(NAMES) for name, one in learned.items()),
        *(_row("parameter in its 95 % interval in the end, share", name, mean_of(one.inside.mean(1)),
               "of the trials that succeed") for name, one in learned.items()),
        *(_row("time of a fall [s]", name, mean_of(one.when), "of the trials that fell")
          for name, one in base.items()),
        *(_row("largest force [N]", name, mean_of(one.strongest), "of the trials that succeed")
          for name, one in base.items()),
        *(_row("largest distance of the cart [m]", name, mean_of(one.furthest), "of the trials that succeed")
          for name, one in base.items()),
    ]  # fmt: skip


def gain(by: Mapping[str, Outcome], name: str) -> Mean:
    """How many more trials succeed than by the EKF."""
    return ahead(1.0 * by[name].success, 1.0 * by["EKF"].success)


def claim(found: Mapping[str, Mapping[str, Outcome]]) -> Claim:
    """That of the paper, whose one trial stands for many."""
    share = mean_of(1.0 * found[BASE]["UKF"].success)
    return Claim(
        "within one trial the UKF stabilises the pendulum without a crash, states and parameters unknown at first",
        {f"it does in {100 * share.value:.1f} ± {100 * share.spread:.1f} % of the trials": share.value >= WANTED},
    )


def findings(found: Mapping[str, Mapping[str, Outcome]]) -> Sequence[str]:
    """What became of the published statement, in words."""
    base = found[BASE]
    share = {name: mean_of(1.0 * one.success) for name, one in base.items()}
    said = "; ".join(f"{name} {100 * m.value:.1f} ± {100 * m.spread:.1f} %" for name, m in share.items())
    ukf = base["UKF"]
    by_noise = "; ".join(
        f"{level} " + ", ".join(f"{name} {by[name].success.mean():.1%}" for name in SPOKEN if name in by)
        for level, by in found.items()
    )
    reached = "reached" if share["UKF"].value >= WANTED else "missed"
    return (
        f"Trials that succeed, of {len(ukf.success)} starts: {said}. {WANTED:.0%} by the UKF: {reached}.",
        f"By noise of the measurements: {by_noise}. That the UKF succeeds more often than the EKF, on the same starts: "
        f"{decided(gain(base, 'UKF'))}.",
        f"In the end the UKF's parameters are off by {np.nanmean(ukf.error):.1f} % on average (worst of the five "
        f"{np.nanmean(ukf.error, axis=0).max():.1f} %), and in their 95 % interval in {np.nanmean(ukf.inside):.0%} of "
        "the trials that succeed: also the common factor of the masses, which the known force shows.",
        f"By the UKF {ukf.fell.sum()} trials fell, after {mean_of(ukf.when).value:.2f} s on average, the last of them "
        f"after {np.nanmax(ukf.when, initial=0.0):.2f} s: lost to the first forces, which are for a pendulum of other "
        f"lengths and masses. Without a limit they would be thousands of newtons; here it is {problem.STRONGEST:g} N.",
    )


def pictures(trial: Trial, found: Mapping[str, Mapping[str, Outcome]], factors: np.ndarray) -> list[Picture]:
    """The figures; `trial` is the first that succeeds, which began with the parameters times `factors`."""
    wrong = ", ".join(f"{name.split()[0]} × {factor:.2f}" for name, factor in zip(NAMES, factors))
    shares = {level: {name: mean_of(1.0 * o.success) for name, o in by.items()} for level, by in found.items()}
    return [
        Picture("pendulum-adaptive-run", "Angles (true, and estimated by the UKF), cart and force in one trial, the "
                "first that succeeds.", tracks(trial)),
        Picture("pendulum-adaptive-parameters", f"Parameters as estimated in that trial, with 95 % intervals; dashed: "
                f"truth. Thought to be at first: {wrong}.", converging(trial, dict(zip(NAMES, TRUTH)))),
        Picture("pendulum-adaptive-success", "Share of trials that succeed, by the noise of the measurements; bars: ± "
                "standard error.", successes(shares)),
    ]  # fmt: skip
