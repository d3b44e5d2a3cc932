"""A flight simulator as the model: states of an F-15 and the failure of its stabilator, estimated together.

Published (Wan & van der Merwe 2001, section 7.5, Figure 7.16): one flight, as a figure without numbers, of a joint UKF
for 12 states and aerodynamic effectiveness in a descent, turn and climb, with 20 dB of noise, turbulence of about
1 m/s, and a failure of half of the stabilator at 65 s. The simulator there is not public; this one is JSBSim's F-15.
Schedule, autopilot, process noise and the drift of the factors are ours (`problems.f15`, `problems.f15_mission`). There
is no EKF: a simulator has no Jacobian. Beside the joint filters: one of the states alone, for which nothing ever fails.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

import sigmapoint as sp
from sigmapoint.experiments.f15.figures import factors, mission, path
from sigmapoint.experiments.f15.runs import ALARM, CLOSE, STATES, Beliefs, Found, Tracked, Tracker
from sigmapoint.experiments.f15.runs import found as found_by
from sigmapoint.experiments.f15.runs import tracked as tracked_by
from sigmapoint.experiments.f15.times import PIECE, Times
from sigmapoint.experiments.f15.times import times as times_of
from sigmapoint.experiments.publishing.results import Claim, Mean, Picture, Row, mean_of, publish, row_of
from sigmapoint.methods import Method
from sigmapoint.problems import f15 as problem
from sigmapoint.problems.f15_mission import FAILURE, LEFT, STEPS, Flight, flights
from sigmapoint.problems.f15_simulator import STEP

METHODS: dict[str, Method] = {"SR-CDKF": sp.srcdkf(), "SR-UKF": sp.srukf(), "UKF": sp.ukf()}
SHOWN, ALONE = "SR-CDKF", "SR-CDKF, states alone"
QUICK = (SHOWN,)
NOTES = {
    "SR-CDKF": "h = √3",
    "SR-UKF": "α=1, β=2, κ=0",
    "UKF": "α=1, β=2, κ=0",
    ALONE: "both factors held at 1",
}
RUNS, QUICK_RUNS = 8, 2
QUICK_STEPS, QUICK_FAILURE = 240, 120
ROUNDS = 25
BARS = ("altitude", "speed", "roll", "pitch", "heading")
WANTED_INSIDE, WANTED_RATIO = 0.9, 1.6
LEARNED: dict[str, Callable[[Found], np.ndarray]] = {
    "stabilator before the failure, mean from 10 s on (true: 1)": lambda one: one.before,
    f"stabilator 10 s after the failure (true: {LEFT})": lambda one: one.after,
    f"share of flights with the stabilator within {CLOSE} of what is left in 10 s": lambda one: one.in_time,
    f"time until the stabilator is within {CLOSE} of what is left [s]": lambda one: one.reached,
    f"share of the time within {CLOSE} of what is left, from 10 s after the failure on": lambda one: one.kept,
    f"time until the failure is reported [s] (95 % interval below {ALARM})": lambda one: one.alarm,
    "share of flights with a failure reported before there is one": lambda one: one.false,
    "share of the time with the stabilator in its 95 % interval": lambda one: one.inside,
    "rms error of the factor of lift": lambda one: one.lift,
    "share of the time with the factor of lift in its 95 % interval": lambda one: one.lift_inside,
}


_row = partial(row_of, "f15")


class Results(NamedTuple):
    """What the page says."""

    tracked: Mapping[str, Tracked]
    found: Mapping[str, Found]
    times: Mapping[str, Times]
    """none of a quick run"""


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    count = runs or (QUICK_RUNS if quick else RUNS)
    steps, failure = (QUICK_STEPS, QUICK_FAILURE) if quick else (STEPS, FAILURE)
    with jax.enable_x64(True):
        keys = jax.random.split(jax.random.key(seed))
        flight = flights(count, steps, failure, keys[0])
        noise = problem.sensors(flight.state)
        y = problem.measured(flight.state, noise, keys[1])
        with closing(problem.simulator(workers=2)) as box:
            joint, alone = problem.joint_model(box, noise), problem.states_model(box, problem.WHOLE, noise)
            trackers = {name: Tracker(joint, METHODS[name]) for name in (QUICK if quick else METHODS)}
            times = {} if quick else times_of(trackers[SHOWN], METHODS[SHOWN], noise, y, flight.u, ROUNDS)
            beliefs = {name: tracker(y, flight.u) for name, tracker in trackers.items()}
            unaware = Tracker(alone, METHODS[SHOWN])(y, flight.u)
        found = {name: found_by(belief, flight, failure) for name, belief in beliefs.items()}
        tracked = {name: tracked_by(b, flight.state, noise) for name, b in {**beliefs, ALONE: unaware}.items()}
        results = Results(tracked, found, times)
        return publish(
            out,
            "A flight simulator as the model: an F-15 whose stabilator fails",
            claim(results),
            findings(results, failure),
            rows(results, count),
            pictures(flight, y, beliefs[SHOWN], failure),
        )


def rows(results: Results, count: int) -> list[Row]:
    """The numbers."""
    tracked, found, times = results
    return [
        *(_row(f"share of the time within 2σ, {state}", name, mean_of(one.inside[state]), NOTES[name])
          for state in (*BARS, "pitch rate") for name, one in tracked.items()),
        *(_row(f"rms error over that of a measurement, {state}", name, mean_of(one.error[state]), NOTES[name])
          for state in STATES for name, one in tracked.items()),
        *(_row(quantity, name, mean_of(number(one)), NOTES[name])
          for quantity, number in LEARNED.items() for name, one in found.items()),
        *(time_rows(times, count) if times else ()),
    ]  # fmt: skip


def time_rows(times: Mapping[str, Times], count: int) -> list[Row]:
    """What two worker processes gain."""
    points = (2 * problem.SIZE + 1) * count * PIECE
    piece = f"{SHOWN}, {count} flights side by side, {PIECE} steps"
    return [
        *(_row("sigma points through the simulator in a second", name, mean_of(points / each), piece)
          for name, each in (("1 worker", times["filter"].one), ("2 workers", times["filter"].two))),
        *(_row("times as fast with two workers as with one, median", name,
               Mean(each.median, np.nan, len(each.ratio)), "of pairs in turns, beside other work of the machine")
          for name, each in times.items()),
        *(_row("times as fast with two workers as with one, by the shortest times", name,
               Mean(each.shortest, np.nan, len(each.one)), "other work of the machine only adds to a time")
          for name, each in times.items()),
    ]  # fmt: skip


def claim(results: Results) -> Claim:
    """That of the paper, with numbers to it."""
    learned = results.found[SHOWN]
    least = min((results.tracked[SHOWN].inside[state].mean(), state) for state in BARS)
    return Claim(
        "states and the failure of a stabilator are estimated together, the simulator being the model",
        {
            f"{least[1]} within two standard deviations {least[0]:.1%} of the time": bool(least[0] >= WANTED_INSIDE),
            f"effectiveness within {CLOSE} of {LEFT} ten seconds after the failure in {learned.in_time.mean():.0%} of "
            "the flights": bool(learned.in_time.all()),
        },
    )


def findings(results: Results, failure: int) -> Sequence[str]:
    """What was found, in words."""
    tracked, learned = results.tracked[SHOWN], results.found[SHOWN]
    alone = results.tracked[ALONE]
    shares = {state: tracked.inside[state].mean() for state in BARS}
    said = ", ".join(f"{state} {share:.1%}" for state, share in shares.items())
    worse = alone.error["pitch rate"].mean() / tracked.error["pitch rate"].mean()
    return (
        f"Share of the time in which the {SHOWN}'s bars of two standard deviations hold the truth: {said}. At least "
        f"{WANTED_INSIDE:.0%} of each: {_reached(min(shares.values()) >= WANTED_INSIDE)}.",
        f"Half of the stabilator's effect is gone after {STEP * failure:g} s. Its estimate is "
        f"{learned.before.mean():.3f} on average before, and {learned.after.mean():.3f} ten seconds after. Within "
        f"{CLOSE} of {LEFT} in these ten seconds: {learned.in_time.mean():.0%} of the flights, after "
        f"{mean_of(learned.reached).value:.1f} s on average. Reported, as a 95 % interval below {ALARM}: in "
        f"{np.isfinite(learned.alarm).mean():.0%} of the flights, after {mean_of(learned.alarm).value:.1f} s on "
        f"average, and before it is there in {learned.false.mean():.0%}.",
        f"The same filter with both factors held at 1, which knows of no failure, has the pitch rate within its bars "
        f"{alone.inside['pitch rate'].mean():.1%} of the time, not {tracked.inside['pitch rate'].mean():.1%}, and its "
        f"rms error is {worse:.2f} times as large.",
        *(_gain(results.times) if results.times else ()),
        "Twelve states are all that the filter has of the simulator. Where it places the aircraft, surfaces are where "
        "the command has them in the end, engines turn as the throttle has them in the end, fuel is as the gauge says, "
        "and the air is still. Each flight is one run of the simulator from beginning to end, in turbulence, with "
        "twice as many steps of integration.",
    )


def _gain(times: Mapping[str, Times]) -> Sequence[str]:
    filtering, counting = times["filter"], times["counting"]
    return (
        f"With two worker processes the filter is {filtering.shortest:.2f} times as fast as with one by the shortest "
        f"of {len(filtering.one)} times, and {filtering.median:.2f} times by the median of pairs. {WANTED_RATIO} times "
        f"by the shortest: {_reached(filtering.shortest >= WANTED_RATIO)}. Two processes that only count were "
        f"{counting.shortest:.2f} and {counting.median:.2f} times as fast as one in the same minutes: so much had the "
        "machine to give beside its other work.",
    )


def _reached(is_so: bool) -> str:
    return "reached" if is_so else "missed"


def pictures(flight: Flight, y: np.ndarray, beliefs: Beliefs, failure: int) -> list[Picture]:
    """The figures, of the first flight."""
    first, seen, belief = jax.tree.map(lambda a: a[0], (flight, y, beliefs))
    dotted = f"Dotted: the failure, after {STEP * failure:g} s."
    return [
        Picture("f15-path", "The first flight from above and from the side. Circle: where the stabilator fails.",
                path(first, seen, belief, failure)),
        Picture("f15-mission", f"Altitude, speed through the air and attitude in that flight as estimated by the "
                f"{SHOWN}; below each the error of the estimate, with ± 2 standard deviations. {dotted}",
                mission(first, seen, belief, failure)),
        Picture("f15-factors", "What is left of stabilator and lift: estimates in all flights (thin) and in the first "
                f"(with 95 % interval); dashed: truth. {dotted}", factors(flight, beliefs, failure)),
    ]  # fmt: skip
