"""A double inverted pendulum of which three of six states are measured: watched by a filter, held up by what it says.

Published (Wan & van der Merwe 2001, section 7.3.1, Figure 7.5), of one run at 10 dB and without numbers: where filters
only watch, "clearly the UKF is better able to track the unobserved states"; where the controller is told the estimate,
"the UKF system is still able to stabilize the pendulum, while the EKF system crashes". Printed are the start, the
sensors, the step, α = 1, β = κ = 0 and 10 dB; noise of the process, initial belief, the controller's weights and whose
power the 10 dB are of are not: those here are ours (`problems.pendulum_state`, `problems.pendulum_control`).

Starts lie about the published one, and every filter has the same starts, noises and, if it only watches, motions. An
error of an angle is that of a direction, at most π: an estimate that is a turn off is right. Beside the published level
there are lower noises, other settings of the UKF, and what theory says of any filter with any controller, near upright
(`pendulum_state_limit`).
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

import sigmapoint as sp
from sigmapoint.experiments.pendulum_state.figures import RATE, errors, film, shares, states
from sigmapoint.experiments.pendulum_state.limit import least_angle
from sigmapoint.experiments.pendulum_state.runs import Found, Runner, by_ranks, outcome, p_value
from sigmapoint.experiments.publishing.results import (
    Claim,
    Film,
    Mean,
    Picture,
    Row,
    Shown,
    ahead,
    mean_of,
    plus_minus,
    publish,
    row_of,
)
from sigmapoint.methods import Method
from sigmapoint.problems import pendulum_state as problem
from sigmapoint.problems.pendulum_state import Told

METHODS: dict[str, tuple[Method, str]] = {
    "EKF": (sp.ekf(), ""),
    "UKF": (sp.ukf(1.0, 0.0, 0.0), "α=1, β=0, κ=0"),
    "SR-UKF, β = 2": (sp.srukf(), "α=1, κ=0"),
    "SR-CDKF": (sp.srcdkf(), "h = √3"),
}
QUICK = ("EKF", "UKF")
TRIED: dict[str, tuple[Method, str]] = {
    "UKF, κ = 3": (sp.ukf(1.0, 0.0, 3.0), "points √9 standard deviations out"),
    "UKF, α = 0.1": (sp.ukf(0.1, 2.0, 0.0), "β = 2; points 0.24 standard deviations out"),
}
WIDER, SHAKEN = 5.0, 10.0
"""times the true spread of the starts, times the true disturbance: what the UKF is told instead"""
LEVELS, QUICK_LEVELS = (10.0, 15.0, 20.0, 25.0, 30.0, 40.0), (10.0, 30.0)
PUBLISHED = 10.0
"""[dB]"""
RUNS, QUICK_RUNS = 200, 20
STEPS, QUICK_STEPS = 200, 100
WANTED = 0.02
SURE = 0.01
KNOWN = "all known"
UNSEEN = ("θ̇1 [rad/s]", "θ2 [rad]", "θ̇2 [rad/s]")


class Results(NamedTuple):
    """What came out, by level [dB] and method."""

    known: Found
    by: Mapping[float, Mapping[str, Found]]
    tried: Mapping[str, Found]
    """at the published level, other settings"""
    limits: Mapping[float, float]
    """[°] see `least_angle`"""


_row = partial(row_of, "pendulum-state")


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    levels, names = (QUICK_LEVELS, QUICK) if quick else (LEVELS, tuple(METHODS))
    with jax.enable_x64(True):
        keys = jax.random.split(jax.random.key(seed))
        count = runs or (QUICK_RUNS if quick else RUNS)
        start, noise = problem.starts(count, keys[0]), problem.noise(count, QUICK_STEPS if quick else STEPS, keys[1])
        known = jax.jit(jax.vmap(problem.held))(start, noise)
        sensors = {level: problem.sensors(np.asarray(known.state), level) for level in levels}
        runners = {name: Runner(METHODS[name][0], start, noise, known) for name in names}
        truth = problem.truth()
        by = {level: {n: r.found(truth, sensors[level]) for n, r in runners.items()} for level in levels}
        tried = {} if quick else _tried(runners["UKF"], sensors[PUBLISHED])
        limits = {level: least_angle(sensor) for level, sensor in sensors.items()}
    results = Results(outcome(known, known), by, tried, limits)
    return publish(
        out,
        "A double inverted pendulum of which half the states are measured",
        claim(results),
        findings(results),
        rows(results, sensors),
        pictures(results),
    )


def _tried(base: Runner, sensors: np.ndarray) -> dict[str, Found]:
    truth = problem.truth()
    told: dict[str, Told] = {
        f"UKF, told {WIDER:g} × the spread of the starts": truth._replace(std=WIDER * truth.std),
        f"UKF, told {SHAKEN:g} × the disturbance": truth._replace(disturbance=SHAKEN * truth.disturbance),
    }
    return {name: base.found(other, sensors) for name, other in told.items()} | {
        name: Runner(method, base.start, base.noise, base.known).found(truth, sensors)
        for name, (method, _) in TRIED.items()
    }


def rows(results: Results, sensors: Mapping[float, np.ndarray]) -> list[Row]:
    """The numbers."""
    noise = {level: "noise {:.2g} m, {:.2g} m/s, {:.2g} rad".format(*sensor) for level, sensor in sensors.items()}
    every = {**results.by[PUBLISHED], **results.tried}
    return [
        _row("share of trials in which a rod passes the horizontal, control by the true state", KNOWN,
             mean_of(1.0 * results.known.fell)),
        *(_row(f"the same, control by the estimate, {level:g} dB", name, mean_of(1.0 * one.fell), noise[level])
          for level, by in results.by.items() for name, one in by.items()),
        *(_row(f"the same on the same starts, UKF minus EKF, {level:g} dB", "UKF",
               ahead(1.0 * by["UKF"].fell, 1.0 * by["EKF"].fell)) for level, by in results.by.items()),
        *(_row(f"time of the crash [s], {PUBLISHED:g} dB", name, mean_of(one.when), "of the trials that crash")
          for name, one in results.by[PUBLISHED].items()),
        *(_row(f"error of {state}, rms over a trial that is only watched, {level:g} dB", name, mean_of(one.error[:, i]))
          for i, state in enumerate(UNSEEN) for level, by in results.by.items() for name, one in by.items()),
        *(_row(f"error of {state} in the same trials, UKF minus EKF", f"{level:g} dB", gain,
               f"p = {p:.2g} by a paired t-test, {ranks:.2g} by signed ranks") for i, state in enumerate(UNSEEN)
          for level, (gain, p, ranks) in compared(results, i).items()),
        *(_row(f"other settings, {PUBLISHED:g} dB: share of trials that crash", name,
               mean_of(1.0 * one.fell), TRIED.get(name, (None, ""))[1]) for name, one in every.items()),
        *(_row(f"other settings, {PUBLISHED:g} dB: error of θ2 where only watched [rad]", name,
               mean_of(one.error[:, 1])) for name, one in every.items()),
        *(Row("pendulum-state", "least that any controller and filter keep the angles to, upright, linear theory [°]",
              f"{level:g} dB", None, limit, None, 1, noise[level]) for level, limit in results.limits.items()),
    ]  # fmt: skip


def compared(results: Results, i: int) -> dict[float, tuple[Mean, float, float]]:
    """Error of an unseen state by the UKF minus that by the EKF, and its p-values, by level."""
    pairs = {level: by["UKF"].error[:, i] - by["EKF"].error[:, i] for level, by in results.by.items()}
    return {level: (mean_of(pair), p_value(pair), by_ranks(pair)) for level, pair in pairs.items()}


def claim(results: Results) -> Claim:
    """That of the paper, at its level of noise."""
    ekf, ukf = (results.by[PUBLISHED][name].fell.mean() for name in QUICK)
    unseen = {state: compared(results, i)[PUBLISHED][:2] for i, state in enumerate(UNSEEN)}
    return Claim(
        f"at {PUBLISHED:g} dB the UKF tracks the unseen states better, and keeps the pendulum up where the EKF crashes",
        {
            f"the UKF crashes in {ukf:.1%} of the trials, the EKF in {ekf:.1%} (less than {WANTED:.0%} by the UKF "
            f"{_first(results)}; at {PUBLISHED:g} dB, held for long, no filter with any controller keeps "
            f"the angles below {results.limits[PUBLISHED]:.0f}° rms, by linear theory)": bool(ukf < WANTED < ekf)
        }
        | {
            f"error of {state}, UKF minus EKF: {plus_minus(gain)} (p = {p:.1g})": gain.value < 0 if p < SURE else None
            for state, (gain, p) in unseen.items()
        },
    )


def findings(results: Results) -> Sequence[str]:
    """What came out, in words."""
    at = results.by[PUBLISHED]
    crashed = "; ".join(f"{name}: {one.fell.sum()}" for name, one in at.items())
    shares = "; ".join(
        f"{level:g} dB " + ", ".join(f"{n} {by[n].fell.mean():.1%}" for n in QUICK) for level, by in results.by.items()
    )
    errors = "; ".join(_verdict(state, *compared(results, i)[PUBLISHED]) for i, state in enumerate(UNSEEN))
    lower = "; ".join(
        f"{level:g} dB " + ", ".join(f"{s} {_sign(*compared(results, i)[level][:2])}" for i, s in enumerate(UNSEEN))
        for level in results.by
        if level != PUBLISHED
    )
    lost = "; ".join(f"{name}: {one.lost.mean():.0%}" for name, one in at.items())
    settings = "; ".join(f"{name}: {one.fell.sum()}" for name, one in results.tried.items())
    met = "met" if at["UKF"].fell.mean() < WANTED else "missed"
    return (
        f"With the estimate in the loop, at the published {PUBLISHED:g} dB, of {len(results.known.fell)} trials crash: "
        f"{crashed}; with everything known {results.known.fell.sum()}. Less than {WANTED:.0%} by the UKF: {met}.",
        f"With less noise: {shares}. The UKF crashes in less than {WANTED:.0%} of the trials {_first(results)}.",
        f"Where filters only watch, at {PUBLISHED:g} dB, UKF minus EKF: {errors}. The direction of the upper rod is at "
        f"some time more than 90° off in these shares of the trials: {lost}.",
        f"UKF against EKF with less noise, by the same test: {lower}.",
        "Why: near upright, to first order, the sensors' noise sets a least root mean square of both angles "
        "together, for any filter with any controller and any force, if held long enough: "
        + ", ".join(f"{limit:.0f}° at {level:g} dB" for level, limit in results.limits.items())
        + ". A rod crashes at 90°.",
        *(
            [f"Trials that crash by other settings at {PUBLISHED:g} dB: {settings}."] if settings else []
        ),
    )  # fmt: skip


def _first(results: Results) -> str:
    """From which level on the UKF seldom crashes."""
    too_little = [level for level, by in results.by.items() if not by["UKF"].fell.mean() < WANTED]
    enough = [level for level in results.by if level > max(too_little, default=0.0)]
    return f"from {min(enough):g} dB on" if enough else "at none of these levels"


def _verdict(state: str, gain: Mean, p: float, ranks: float) -> str:
    return f"{state} {gain.value:+.3f} ± {gain.spread:.3f} (p = {p:.1g}, by signed ranks {ranks:.1g}), {_sign(gain, p)}"


def _sign(gain: Mean, p: float) -> str:
    if not p < SURE:
        return "no difference shown"
    return "UKF better" if gain.value < 0 else "EKF better"


def telling(by: Mapping[float, Mapping[str, Found]]) -> tuple[float, int]:
    """The level [dB] at which most trials crash by the EKF and not by the UKF, and the first of these."""
    apart = {level: found["EKF"].fell & ~found["UKF"].fell for level, found in by.items()}
    level = max(apart, key=lambda level: int(apart[level].sum()))
    return level, int(np.argmax(apart[level]))


def pictures(results: Results) -> Sequence[Shown]:
    """The figures and the film."""
    level, i = telling(results.by)
    ekf, ukf = (results.by[level][name].fell for name in QUICK)
    shown = {name: results.by[level][name].trusted.at(i) for name in QUICK}
    watching = {name: results.by[PUBLISHED][name].watched.at(0) for name in QUICK}
    less = {name: results.by[level][name].watched.at(0) for name in QUICK}
    how = "; ".join(f"{name}: {'crashes' if results.by[level][name].fell[i] else 'stays up'}" for name in QUICK)
    return (
        Film("pendulum-state-film", f"The same start and noises, {level:g} dB, controlled by what a filter estimates. "
             f"Black: the pendulum; colour: as estimated. {how}. At this level {(ekf & ~ukf).sum()} trials crash by "
             f"the EKF only, and {(ukf & ~ekf).sum()} by the UKF only; shown is the first of the former, where there "
             "is one.", film(shown), RATE),
        Picture("pendulum-state-shares", "Share of trials that crash by the level of the noise, and how many are still "
                "up by time; dashed: with everything known.",
                shares(results.by, float(results.known.fell.mean()), PUBLISHED)),
        Picture("pendulum-state-errors", "Errors of the unseen states where filters only watch, mean over trials of "
                "the root mean square over a trial; bars: ± standard error.", errors(results.by, UNSEEN)),
        Picture("pendulum-state-published", f"As Figure 7.5: one trial that filters only watch, the first, at "
                f"{PUBLISHED:g} dB.", states(watching)),
        Picture("pendulum-state-less", f"The same trial at {level:g} dB.", states(less)),
    )  # fmt: skip
