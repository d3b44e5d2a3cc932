"""Natural frequencies of two masses on springs, estimated jointly with their motion, at and above Nyquist sampling.

Published (Wan & van der Merwe 2001, section 7.5.1, Figures 7.14 and 7.15): "the EKF does not converge to the true value
for ω₂", sampled at Nyquist of ω₂, which "emphasizes the effect of linearization in the EKF. For faster sampling rates
the performance of the EKF and UKF become more similar." As there: process noise at 100 dB, measurements at 60 dB, a
fixed drift. Masses, frequencies, starts, priors and number of steps are not printed; those here are ours.

One curve is no evidence, so here are shares of runs that end within 1 % of both frequencies: random motions, random
starts, two widths of the prior, four sampling rates, and motions released from rest, of which an exact Nyquist step
sees the turning points only (`problems.masses`). The state at the start is unknown: mean 0, deviation of the motion.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np

import sigmapoint as sp
from sigmapoint.experiments.modes.figures import shares, tracks
from sigmapoint.experiments.modes.runs import CLOSE, Case, Found, draw, estimator
from sigmapoint.experiments.publishing.results import Claim, Mean, Picture, Row, decided, mean_of, publish, row_of
from sigmapoint.methods import Method
from sigmapoint.problems import masses

METHODS: dict[str, tuple[Method, str]] = {
    "EKF": (sp.ekf(), ""),
    "UKF": (sp.ukf(), "α=1, β=2, κ=0"),
    "SR-UKF": (sp.srukf(), "α=1, β=2, κ=0"),
    "CDKF": (sp.cdkf(), "h = √3"),
    "SR-CDKF": (sp.srcdkf(), "h = √3"),
    "iterated EKF": (sp.iterated(sp.ekf(), 5), "5 passes of an update whose measurement is linear: nothing to gain"),
    "iterated SR-CDKF": (sp.iterated(sp.srcdkf(), 5), "5 passes, h = √3"),
}
QUICK = ("EKF", "UKF")
RUNS, QUICK_RUNS = 200, 8
NYQUIST, ABOVE = Case(1.0, 0.3, False), Case(1.2, 0.3, False)
CASES = tuple(
    Case(rate, prior, rest) for rest in (False, True) for prior in (0.1, 0.3) for rate in (1.0, 1.2, 2.0, 5.0)
)
QUICK_CASES = (Case(1.0, 0.1, False), NYQUIST, ABOVE)
FOUND = 0.95
"""share of the runs"""

Results = Mapping[Case, Mapping[str, Found]]
_row = partial(row_of, "modes")


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    count, names, cases = runs or (QUICK_RUNS if quick else RUNS), QUICK if quick else tuple(METHODS), CASES
    with jax.enable_x64(True):
        drawn = draw(count, jax.random.key(seed))
        estimators = {name: estimator(METHODS[name][0]) for name in names}
        found = {
            case: {name: estimate(case, drawn) for name, estimate in estimators.items()}
            for case in (QUICK_CASES if quick else cases)
        }
    return publish(
        out,
        "Natural frequencies of two masses, estimated with their motion",
        claim(found),
        findings(found),
        rows(found),
        [
            Picture(
                "modes-nyquist",
                f"Estimates over steps at {NYQUIST.text}, all runs; black: truth.",
                tracks({name: found[NYQUIST][name].value for name in QUICK}, masses.TRUTH),
            ),
            Picture(
                "modes-shares",
                "Share of the runs that end within 1 % of both frequencies; bars: ± standard error.",
                shares({c.text: {name: mean_of(one.both) for name, one in by.items()} for c, by in found.items()}),
            ),
        ],
    )


def rows(found: Results) -> list[Row]:
    """The numbers."""
    nyquist = {case: by for case, by in found.items() if case.rate == 1}
    note = {name: text for name, (_, text) in METHODS.items()}
    return [
        *(_row(f"share of runs within 1 % of ω{i + 1}, {case.text}", name, mean_of(one.close[:, i]), note[name])
          for case, by in nyquist.items() for i in range(2) for name, one in by.items()),
        *(_row(f"share of runs within 1 % of both, {case.text}", name, mean_of(one.both), note[name])
          for case, by in found.items() for name, one in by.items()),
        *(_row(f"share of runs with ω2 in its 95 % interval, {case.text}", name, mean_of(one.inside[:, 1]))
          for case, by in found.items() if case.rate < 2 and not case.rest for name, one in by.items()),
        *(_row(f"share of runs within 1 % of the mirror image of ω2, {case.text}", name, mirrored(case, one))
          for case, by in found.items() if 1 < case.rate < 2 for name, one in by.items()),
        *(_row("share of runs within 1 % of both, UKF minus EKF on the same runs", case.text, gain(by))
          for case, by in found.items()),
        *(_row(f"error of ω2 in the runs within 1 %, median, %, {case.text}", name, accuracy(one))
          for case, by in nyquist.items() for name, one in by.items()),
    ]  # fmt: skip


def mirrored(case: Case, found: Found) -> Mean:
    """Share of runs that end within 1 % of what the samples cannot tell from ω₂."""
    mirror = (2 * case.rate - 1) * masses.TRUTH[1]
    return mean_of(1.0 * (np.abs(found.value[:, -1, 1] / mirror - 1) < CLOSE))


def gain(by: Mapping[str, Found]) -> Mean:
    """How many more runs the UKF brings within 1 % of both."""
    return mean_of(by["UKF"].both - by["EKF"].both)


def accuracy(found: Found) -> Mean:
    """[%] of ω₂, median over the runs that are close, with the standard error of a median of Gaussians."""
    error = 100 * np.abs(found.value[:, -1, 1] / masses.TRUTH[1] - 1)
    kept = error[found.close[:, 1] > 0]
    mean = mean_of(kept)
    return Mean(float(np.median(kept)) if kept.size else np.nan, 1.25 * mean.spread, mean.runs)


def claim(found: Results) -> Claim:
    """That of the paper, at the published rate."""
    ekf, ukf = (mean_of(found[NYQUIST][name].close[:, 1]).value for name in QUICK)
    both = mean_of(found[NYQUIST]["UKF"].both).value
    return Claim(
        "the UKF finds both frequencies, the EKF does not converge to ω2",
        {
            f"UKF within 1 % of both in {both:.1%} of the runs": both > FOUND,
            f"EKF within 1 % of ω2 in {ekf:.1%} of the runs (UKF: {ukf:.1%})": ekf < 0.5,
        },
    )


def findings(found: Results) -> Sequence[str]:
    """What became of the published statements, in words."""

    def share(case: Case, name: str, i: int) -> str:
        return f"{mean_of(found[case][name].close[:, i]).value:.1%}"

    nyquist = [case for case in found if case.rate == 1]
    at = "; ".join(
        f"{case.text}: EKF {share(case, 'EKF', 0)} and {share(case, 'EKF', 1)}, "
        f"UKF {share(case, 'UKF', 0)} and {share(case, 'UKF', 1)}"
        for case in nyquist
    )
    gains = "; ".join(
        f"{case.text} {100 * gain(by).value:+.1f} ± {100 * gain(by).spread:.1f}" for case, by in found.items()
    )
    misses = "reproduced" if all(mean_of(found[case]["EKF"].close[:, 1]).value < 0.5 for case in nyquist) else (
        "not so in most runs")  # fmt: skip
    return (
        f"Runs that end within 1 % of ω1 and of ω2. {at}.",
        f'"The EKF does not converge to the true value for ω2", at Nyquist: {misses}. That the UKF is ahead of the EKF '
        f"on the same runs, at {NYQUIST.text}: {decided(gain(found[NYQUIST]))}.",
        f"More runs within 1 % of both by the UKF than by the EKF, in percentage points: {gains}.",
        "Exactly at Nyquist the second mode only changes its sign from sample to sample, and that it does neither more "
        "nor less says that ω2 is at Nyquist. A little above, the samples beat, and a frequency as far on the other "
        f"side fits as well with the phase reversed. At {ABOVE.text} "
        + ", ".join(
            f"{mirrored(ABOVE, found[ABOVE][name]).value:.1%} of the runs end there by the {name}" for name in QUICK
        )
        + ": wide starts make that an honest answer. What remains is lost by the filter.",
    )
