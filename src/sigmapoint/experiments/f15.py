"""A flight simulator as the model: states of an F-15 and the failure of its stabilator, estimated together.

Published (Wan & van der Merwe 2001, section 7.5, Figure 7.16): one flight, as a figure without numbers, of a joint UKF
for 12 states and aerodynamic effectiveness in a descent, turn and climb, with 20 dB of noise, turbulence of about 1 m/s,
and a failure of half of the stabilator at 65 s. The simulator there is not public; this one is JSBSim's F-15. Schedule,
autopilot, process noise and the drift of the factors are ours (`problems.f15`, `problems.f15_mission`). There is no
EKF: a simulator has no Jacobian. Beside the joint filters: one of the states alone, for which nothing ever fails.

The time of the filter is measured with one and two worker processes, in turns, on a piece of all flights side by side.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

import sigmapoint as sp
from sigmapoint.experiments import f15_runs as runs_of
from sigmapoint.experiments.f15_figures import factors, mission, path
from sigmapoint.experiments.f15_runs import ALARM, CLOSE, STATES, Beliefs, Found, Times, Tracked, Tracker
from sigmapoint.experiments.results import Mean, Picture, Row, mean_of, publish, row_of
from sigmapoint.methods import Method
from sigmapoint.problems import f15 as problem
from sigmapoint.problems.f15_mission import FAILURE, LEFT, STEPS, Flight, flights
from sigmapoint.problems.f15_simulator import STEP

METHODS: dict[str, Method] = {"SR-CDKF": sp.srcdkf(), "SR-UKF": sp.srukf(), "UKF": sp.ukf()}
NOTES = {
    "SR-CDKF": "h = √3",
    "SR-UKF": "α=1, β=2, κ=0",
    "UKF": "α=1, β=2, κ=0",
    "SR-CDKF, states alone": "both factors held at 1",
}
SHOWN, ALONE = "SR-CDKF", "SR-CDKF, states alone"
QUICK = (SHOWN,)
RUNS, QUICK_RUNS = 10, 2
QUICK_STEPS, QUICK_FAILURE = 240, 120
PIECE = 5
"""steps whose time is taken"""
PAIRS, QUICK_PAIRS = 25, 3
BARS = ("altitude", "speed", "roll", "pitch", "heading")
WANTED_INSIDE, WANTED_RATIO = 0.9, 1.6
WORKERS = 2


class Outcome(NamedTuple):
    """What a method makes of all flights."""

    beliefs: Beliefs
    tracked: Tracked


_row = partial(row_of, "f15")


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    count = runs or (QUICK_RUNS if quick else RUNS)
    steps, failure = (QUICK_STEPS, QUICK_FAILURE) if quick else (STEPS, FAILURE)
    with jax.enable_x64(True):
        keys = jax.random.split(jax.random.key(seed))
        flight = flights(count, steps, failure, keys[0])
        noise = problem.sensors(flight.state)
        y = problem.measured(flight.state, noise, keys[1])

        def outcome(tracker: Callable[..., Beliefs]) -> Outcome:
            beliefs = tracker(y, flight.u)
            return Outcome(beliefs, runs_of.tracked(beliefs, flight.state, noise))

        with closing(problem.simulator(WORKERS)) as box, closing(problem.simulator(1)) as slow:
            joint, alone = problem.joint_model(box, noise), problem.states_model(box, problem.WHOLE, noise)
            trackers = {name: Tracker(joint, METHODS[name]) for name in (QUICK if quick else METHODS)}
            piece = jax.tree.map(lambda a: a[:, :PIECE], (y, flight.u))
            times = runs_of.timed(
                partial(Tracker(problem.joint_model(slow, noise), METHODS[SHOWN]), *piece),
                partial(trackers[SHOWN], *piece),
                QUICK_PAIRS if quick else PAIRS,
            )
            outcomes = {name: outcome(tracker) for name, tracker in trackers.items()}
            outcomes[ALONE] = outcome(Tracker(alone, METHODS[SHOWN]))
        found = {name: runs_of.found(outcomes[name].beliefs, flight, failure) for name in trackers}
    tracks = {name: one.tracked for name, one in outcomes.items()}
    return publish(
        out,
        "A flight simulator as the model: an F-15 whose stabilator fails",
        findings(tracks, found, times, failure),
        rows(tracks, found, times, count),
        pictures(flight, y, outcomes[SHOWN].beliefs, failure),
    )


def rows(tracks: Mapping[str, Tracked], found: Mapping[str, Found], times: Times, count: int) -> list[Row]:
    """The numbers."""
    ratio = times.one / times.two
    note = f"{count} flights side by side, {PIECE} steps; "
    points = 29 * count * PIECE
    return [
        *(_row(f"share of the time within 2σ, {state}", name, mean_of(one.inside[state]), NOTES[name])
          for state in (*BARS, "q") for name, one in tracks.items()),
        *(_row(f"rms error over that of a measurement, {state}", name, mean_of(one.error[state]), NOTES[name])
          for state in STATES for name, one in tracks.items()),
        *(_row("stabilator before the failure", name, mean_of(one.before), "true: 1; mean from 10 s on")
          for name, one in found.items()),
        *(_row("stabilator 10 s after the failure", name, mean_of(one.after), f"true: {LEFT}")
          for name, one in found.items()),
        *(_row(f"within {CLOSE} of what is left, share of flights within 10 s", name, mean_of(within(one)))
          for name, one in found.items()),
        *(_row(f"time until the stabilator is within {CLOSE} of what is left [s]", name, mean_of(one.reached))
          for name, one in found.items()),
        *(_row(f"within {CLOSE} of what is left, share of the time from 10 s after on", name, mean_of(one.kept))
          for name, one in found.items()),
        *(_row("time until the failure is reported [s]", name, mean_of(one.alarm), f"95 % interval below {ALARM}")
          for name, one in found.items()),
        *(_row("flights in which one is reported too early, share", name, mean_of(one.false)) for name, one in
          found.items()),
        *(_row("stabilator in its 95 % interval, share of the time", name, mean_of(one.inside),
               "without the first 10 s of the flight and of the failure") for name, one in found.items()),
        *(_row("rms error of the factor of lift", name, mean_of(one.lift), "from 10 s on") for name, one in
          found.items()),
        *(_row("factor of lift in its 95 % interval, share of the time", name, mean_of(one.lift_inside))
          for name, one in found.items()),
        *(_row("simulated sigma points in a second", name, mean_of(points / each), f"{SHOWN}; {note}as is")
          for name, each in (("1 worker", times.one), ("2 workers", times.two))),
        _row("time with 1 worker over that with 2", "median", Mean(float(np.median(ratio)), *mean_of(ratio)[1:]),
             f"{note}{len(ratio)} pairs in turns; other work on the machine is in it"),
        Row("f15", "time with 1 worker over that with 2", "shortest of each", None, times.shortest, None, len(ratio),
            f"{note}the shortest of {len(ratio)} times of each: other work on the machine only adds"),
    ]  # fmt: skip


def within(one: Found) -> np.ndarray:
    """1 for a flight whose estimate comes close to what is left within ten seconds."""
    return 1.0 * (one.reached <= runs_of.WITHIN * STEP)


def findings(tracks: Mapping[str, Tracked], found: Mapping[str, Found], times: Times, failure: int) -> Sequence[str]:
    """What was found, in words."""
    shown, stabilator = tracks[SHOWN], found[SHOWN]
    shares = {state: shown.inside[state].mean() for state in BARS}
    said = ", ".join(f"{state} {share:.1%}" for state, share in shares.items())
    least = "reached" if min(shares.values()) >= WANTED_INSIDE else "missed"
    close = within(stabilator).mean()
    fast = max(float(np.median(times.one / times.two)), times.shortest)
    alone = tracks[ALONE]
    return (
        f"Share of the time in which the {SHOWN}'s bars of two standard deviations hold the truth: {said}. At least "
        f"{WANTED_INSIDE:.0%} of each: {least}.",
        f"Half of the stabilator's effect is gone after {STEP * failure:g} s. Its estimate is {stabilator.before.mean():.3f} "
        f"on average before, and {stabilator.after.mean():.3f} ten seconds after; within {CLOSE} of {LEFT} it is after "
        f"{np.nanmean(stabilator.reached):.1f} s on average, and in {close:.0%} of the flights within 10 s.",
        f"Reported, as a 95 % interval below {ALARM}, it is in {np.isfinite(stabilator.alarm).sum()} of "
        f"{len(stabilator.alarm)} flights, after {np.nanmean(stabilator.alarm):.1f} s on average; too early in "
        f"{int(stabilator.false.sum())}.",
        f"A filter that knows nothing of failures has the pitch rate within its bars {alone.inside['q'].mean():.1%} of "
        f"the time, with an rms error {alone.error['q'].mean() / shown.error['q'].mean():.2f} times as large.",
        f"With two worker processes the filter is {np.median(times.one / times.two):.2f} times as fast as with one by "
        f"the median of {len(times.one)} pairs, and {times.shortest:.2f} times by the shortest times. {WANTED_RATIO} "
        f"times by either: {'reached' if fast >= WANTED_RATIO else 'missed'}. Two processes need two processors that "
        "nothing else is using.",
        "Twelve states are what the filter has of the simulator. Where it places the aircraft, surfaces are where the "
        "command has them in the end and engines turn as the throttle has them in the end; fuel is as the gauge says. "
        "The flights themselves are one run of the simulator each, at its own rate of integration, twice the filter's.",
    )


def pictures(flight: Flight, y: np.ndarray, beliefs: Beliefs, failure: int) -> list[Picture]:
    """The figures, of the first flight."""
    first, seen, belief = jax.tree.map(lambda a: a[0], (flight, y, beliefs))
    begin = f"Dotted: the failure, after {STEP * failure:g} s."
    return [
        Picture("f15-path", "One flight from above and from the side: true, and estimated. The circle is where the "
                "stabilator fails.", path(first, seen, belief, failure)),
        Picture("f15-mission", "Altitude, speed through the air and attitude in that flight: truth, measurements and "
                f"estimates. Below each: error of the estimate with ± 2 standard deviations. {begin}",
                mission(first, seen, belief, failure)),
        Picture("f15-factors", f"What is left of the stabilator and of lift, estimated, with 95 % intervals, in all "
                f"flights (light) and the first; dashed: truth. {begin}", factors(flight, beliefs, failure)),
    ]  # fmt: skip
