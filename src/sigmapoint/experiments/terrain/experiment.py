"""Terrain-aided navigation: several hypotheses, which every Gaussian filter makes one of, and particle filters keep.

The ground below an aircraft is as high at another ridge, 3 km off, and remains so for more than a minute
(`problems.terrain`). The belief has two or three peaks for as long, and then one. A Gaussian stands for one place: it
covers all ridges, or settles upon one of them too soon. That this is lost by every Gaussian filter, and not by particle
filters, is what is to be shown: errors over the last third of a flight, flights lost, and the density that a belief
gives to the true position (`terrain_runs`), by more than three standard errors on the same flights.

A proposal that looks at the measurement does so at the first instant too, where the only Gaussian to look with is the
initial belief of 2 km: what it becomes lies about one ridge, and so do all particles. So these filters are also run
without the first height. The exact belief has no formula; a bootstrap filter with twenty times the particles stands in.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np

import sigmapoint as sp
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
from sigmapoint.experiments.terrain.figures import VIEW, Flight, errors, ridge
from sigmapoint.experiments.terrain.runs import FAR, Flights, Found, belief_of, flown, found
from sigmapoint.problems import terrain
from sigmapoint.recipe import Recipe

PARTICLES = 1000
GAUSSIAN: dict[str, tuple[Recipe, str]] = {
    "EKF": (sp.ekf(), ""),
    "iterated EKF": (sp.iterated(sp.ekf(), 5), "5 passes"),
    "UKF": (sp.ukf(), "α=1, β=2, κ=0"),
    "SR-UKF": (sp.srukf(), "α=1, β=2, κ=0"),
    "SR-CDKF": (sp.srcdkf(), "h = √3"),
    "GHKF(5)": (sp.ghkf(5), ""),
}
GUIDED = sp.particle_filter(PARTICLES, proposal=sp.proposals.guided(sp.ekf()))
DRAWN: dict[str, tuple[Recipe, str]] = {
    "bootstrap": (sp.bootstrap(PARTICLES), ""),
    "auxiliary": (sp.auxiliary(sp.bootstrap(PARTICLES)), "bootstrap, chosen by the next measurement"),
    "guided": (GUIDED, "by an EKF for each particle"),
    "UPF": (sp.upf(PARTICLES), "by an SR-UKF carried along with each particle"),
    "Rao-Blackwellised": (sp.rao_blackwellised(PARTICLES, ("position",)), "position drawn, speed Gaussian"),
    **{f"GSPF({G})": (sp.gspf(PARTICLES, G), f"{G} components") for G in (5, 10, 20)},
    **{f"GMSPPF({G})": (sp.gmsppf(PARTICLES, G), f"{G} components") for G in (5, 10)},
    "guided, from 1 s on": (GUIDED, "the first height left out"),
    "UPF, from 1 s on": (sp.upf(PARTICLES), "the first height left out"),
}
LATER = {"guided": "guided, from 1 s on", "UPF": "UPF, from 1 s on"}
METHODS = GAUSSIAN | DRAWN
QUICK = ("UKF", "bootstrap", "GSPF(5)")
RUNS, QUICK_RUNS = 100, 6
MANY, QUICK_MANY = 20_000, 2000
"""particles of the reference"""
REFERENCE, RECKONED = "reference", "dead reckoning"
FILLED, LINE = "bootstrap", "UKF"
"""beliefs in the figure of one flight"""
UNDECIDED = 1000.0
"""[m] a belief that is wider has more than one ridge in it"""

Results = Mapping[str, Found]
_row = partial(row_of, "terrain")


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    count, many = runs or (QUICK_RUNS if quick else RUNS), QUICK_MANY if quick else MANY
    with jax.enable_x64(True):
        for_flights, for_filters = jax.random.split(jax.random.key(seed))
        flights = flown(count, for_flights)
        blind, later = (flights._replace(y=flights.y.at[:, rows].set(np.nan)) for rows in (slice(None), 0))
        results = {
            name: found(METHODS[name][0], later if name in LATER.values() else flights, for_filters)
            for name in (QUICK if quick else METHODS)
        }
        reference = found(sp.bootstrap(many), flights, for_filters)
        reckoned = found(sp.ekf(), blind, for_filters)
        pictures = _pictures(results, reference, flights, for_filters)
    notes = {REFERENCE: f"bootstrap, {many:,} particles", RECKONED: "no measurement"}
    return publish(
        out,
        "Terrain-aided navigation: several hypotheses",
        claim(results),
        findings(results, reference, reckoned),
        rows({**results, REFERENCE: reference, RECKONED: reckoned}, notes),
        pictures,
    )


def rows(results: Results, notes: Mapping[str, str]) -> list[Row]:
    """The numbers."""
    note = {name: text for name, (_, text) in METHODS.items()} | dict(notes)
    seen = {name: one for name, one in results.items() if name != RECKONED}
    late, known = best(results, "late"), best(results, "known")
    drawn = {name: one for name, one in results.items() if name in DRAWN}
    quantities = {
        "error of the position over the last third, rms, m": "late",
        f"share of flights lost, more than {FAR:g} m off at the end": "lost",
        "logarithm of the density of the true position, 1/m, mean over time": "known",
        "share of the time that the position is within 2 σ": "inside",
    }
    return [
        *(_row(quantity, name, mean_of(getattr(one, field)), _told(note[name], one))
          for quantity, field in quantities.items() for name, one in results.items()),
        *(_row("logarithm of the likelihood of a flight's heights", name, mean_of(one.log_likelihood))
          for name, one in seen.items()),
        *(_row(f"error of the {late} minus that on the same flights, m", name, ahead(results[late].late, one.late))
          for name, one in drawn.items()),
        *(_row(f"logarithm of the density minus that of the {known} on the same flights", name,
               ahead(one.known, results[known].known)) for name, one in drawn.items()),
    ]  # fmt: skip


def best(results: Results, field: str) -> str:
    """The Gaussian filter that is best by the mean of one number."""
    means = {name: mean_of(getattr(one, field)).value for name, one in results.items() if name in GAUSSIAN}
    return max(means, key=lambda name: means[name] if field == "known" else -means[name])


def _told(note: str, one: Found) -> str:
    unexplained = int(one.unexplained.sum())
    return "; ".join(filter(None, (note, f"no particle possible at {unexplained} instants" if unexplained else "")))


def claim(results: Results) -> Claim:
    """Ours: the papers have no such problem."""
    late = best(results, "late")
    sums = [name for name in results if name.startswith(("GSPF", "GMSPPF"))]
    gains = {name: ahead(results[late].late, results[name].late) for name in sums}
    return Claim(
        "(ours) where a belief has several modes, Gaussian sums are closer than the best Gaussian filter",
        {f"{name} closer than the {late} by {_pm(gain, '.0f')} m": positive(gain) for name, gain in gains.items()},
    )


def findings(results: Results, reference: Found, reckoned: Found) -> Sequence[str]:
    """What came out, in words."""
    late, known = best(results, "late"), best(results, "known")
    drawn = [name for name in results if name in DRAWN]
    closer = {name: ahead(results[late].late, results[name].late) for name in drawn}
    surer = {name: ahead(results[name].known, results[known].known) for name in drawn}
    open_for = terrain.STEP * (reference.std > UNDECIDED).sum(1)
    return (
        f"By the reference, the belief is wider than {UNDECIDED:g} m, which is more than one ridge, for "
        f"{_pm(mean_of(open_for), '.0f')} s of {terrain.STEP * terrain.STEPS:g} s.",
        f"Of the Gaussian filters the {late} is the best over the last third, with an error of "
        f"{_pm(mean_of(results[late].late), '.0f')} m, where dead reckoning has "
        f"{_pm(mean_of(reckoned.late), '.0f')} m and the reference {_pm(mean_of(reference.late), '.0f')} m. It ends "
        f"{mean_of(results[late].lost).value:.0%} of its flights more than {FAR:g} m off; the reference "
        f"{mean_of(reference.lost).value:.0%}.",
        f"That particle filters are closer than the {late} on the same flights, by m: {_verdicts(closer, '.0f')}.",
        f"That their beliefs give the true position a higher density than the {known}, the best Gaussian by that "
        f"measure, does, in logarithms: {_verdicts(surer, '.2f')}. Dead reckoning is at "
        f"{_pm(ahead(reckoned.known, results[known].known), '.2f')} from it.",
        *(
            f"Where the first height is left out, and all particles start as they were drawn, the {name} filter loses "
            f"{mean_of(results[later].lost).value:.0%} of the flights, in place of "
            f"{mean_of(results[name].lost).value:.0%}."
            for name, later in LATER.items()
            if later in results
        ),
    )


def _pm(mean: Mean, form: str) -> str:
    return f"{mean.value:{form}} ± {mean.spread:{form}}"


def _verdicts(gains: Mapping[str, Mean], form: str) -> str:
    said = {name: decided(gain).replace("reproduced", "shown") for name, gain in gains.items()}  # of a claim of ours
    return "; ".join(f"{name} {_pm(gain, form)}, {said[name]}" for name, gain in gains.items())


def longest_open(reference: Found, line: Found, off: np.ndarray) -> int:
    """The flight whose belief is wide for the longest time, of those found in the end, if possible not by `line`.

    Args:
        reference: what there is to be believed.
        line: a filter that shows better where it is lost, but within the figure.
        off: [m] true positions from where dead reckoning has them, at the end of each flight (R,).
    """
    wide = (reference.std > UNDECIDED).sum(1)
    fine = (reference.std[:, -1] < FAR) & (reference.lost == 0)
    shown = (line.lost == 1) & (np.abs(line.error[:, -1] + off) < VIEW)
    return int(np.argmax(wide + terrain.STEPS * (fine * (1.0 + shown))))


def other_ridge(reference: Found, i: int) -> float:
    """[m] from the true position to the ridge that is the next likely, by the side on which the mean is off."""
    wide = reference.std[i] > UNDECIDED
    return terrain.RIDGE * float(np.sign(reference.error[i][wide].mean() if wide.any() else 1.0))


def _pictures(results: Results, reference: Found, flights: Flights, key: jax.Array) -> Sequence[Picture]:
    reckoned = terrain.SPEED * terrain.STEP * (terrain.STEPS - 1)
    i = longest_open(reference, results[LINE], np.asarray(flights.x)[:, -1, 0] - reckoned)
    y = flights.y[i]
    x, heights = np.asarray(flights.x[i])[:, 0], np.asarray(y)[:, 0]
    beliefs = ((name, belief_of(METHODS[name][0], y, key)) for name in (FILLED, LINE))
    flight = Flight(x, heights, other_ridge(reference, i), *beliefs)
    panels = {
        title: {name: _rms(one) for name, one in results.items() if name in kind}
        for title, kind in (("Gaussian filters", GAUSSIAN), (f"particle filters, {PARTICLES:,} particles", DRAWN))
    }
    return (
        Picture(
            "terrain-ridge",
            f"What is believed of the position in one flight, time passing upwards: the {FILLED} filter filled, the "
            f"{LINE} as a line, on one scale at each instant. Below: the terrain, and the measured heights at the true "
            "position and as far on as the other hypothesis is.",
            ridge(flight),
        ),
        Picture(
            "terrain-errors",
            "Error of the position over time, rms over all flights; dashed: the reference. UKF and SR-UKF agree.",
            errors(panels, (REFERENCE, _rms(reference))),
        ),
    )


def _rms(one: Found) -> np.ndarray:
    return np.sqrt((one.error**2).mean(0))
