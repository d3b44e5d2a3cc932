"""Rosenbrock's valley by Kalman filters: a residual whose target is zero, beside Levenberg-Marquardt and BFGS.

Wan & van der Merwe (2001), Figure 7.12: EKF and UKF are indistinguishable, and "comparable or superior to a number of
alternative optimization approaches (e.g., Davidon-Fletcher-Powell, Levenberg-Marquardt, etc.)"; the UKF with the value
at the mean (option 2) and α = 1e-4. The paper shows curves and prints no numbers; noise and drift are not given.

Here the noise is 1e-6 and the drift 1e-2 at every update, and others are tried.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

import sigmapoint as sp
from sigmapoint.experiments.publishing.results import Claim, Picture, Row, mean_of, plus_minus, publish
from sigmapoint.experiments.rosenbrock.figures import valley
from sigmapoint.experiments.rosenbrock.searches import UPDATES, Search, bfgs, filtered, levenberg_marquardt
from sigmapoint.learning.drift import Drift
from sigmapoint.methods import Method
from sigmapoint.problems import rosenbrock

RUNS, QUICK_RUNS = 100, 5
WIDTH = 2.0
"""random starts are uniform over ± this in both directions"""
NOISE, DRIFT = 1e-6, sp.fixed(1e-2)
SMALL = {"alpha": 1e-4, "beta": 2.0, "kappa": 1.0}
UKF = "SR-UKF, option 2"
FILTERS: dict[str, tuple[Method, str]] = {
    UKF: (sp.at_mean(sp.srukf(**SMALL)), "α=1e-4, β=2, κ=3−n, as in the paper; 5 points an update"),
    "EKF": (sp.ekf(), "a value and a Jacobian an update"),
    "SR-CDKF, option 2": (sp.at_mean(sp.srcdkf()), "h = √3: the valley's bend over the points counts as noise"),
    "SR-UKF": (sp.srukf(**SMALL), "α=1e-4, β=2, κ=3−n; option 1, the mean output"),
    "SR-CDKF": (sp.srcdkf(), "h = √3; option 1"),
}
SEARCHES: dict[str, tuple[Callable[[np.ndarray], Search], str]] = {
    "Levenberg-Marquardt": (levenberg_marquardt, "SciPy, exact Jacobian"),
    "BFGS": (bfgs, "SciPy, exact gradient of f"),
    "Levenberg-Marquardt, differences": (lambda x: levenberg_marquardt(x, False), "SciPy, Jacobian by differences"),
    "BFGS, differences": (lambda x: bfgs(x, False), "SciPy, gradient by differences"),
}
SHOWN = (UKF, "EKF", "SR-CDKF, option 2", "Levenberg-Marquardt", "BFGS")
OTHERS: dict[str, tuple[float, Drift]] = {
    "noise 1e-4": (1e-4, DRIFT),
    "noise 1e-2": (1e-2, DRIFT),
    "drift fixed(1)": (NOISE, sp.fixed(1.0)),
    "drift fixed(1e-4)": (NOISE, sp.fixed(1e-4)),
    "drift forgetting(0.5)": (NOISE, sp.forgetting(0.5)),
    "drift robbins_monro(1, 0.5)": (NOISE, sp.robbins_monro(1.0, 0.5)),
}
QUICK_OTHERS = ("noise 1e-4", "noise 1e-2")
QUANTITIES: dict[str, Callable[[Search], float]] = {
    "iterations": lambda s: s.iterations,
    "values": lambda s: s.values,
    "derivatives": lambda s: s.derivatives,
}
NOTES = {name: note for name, (_, note) in {**FILTERS, **SEARCHES}.items()}

COMPARABLE = 1.5
"""times as many values are still that"""
Found = dict[str, list[Search]]


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    random = np.random.default_rng(seed).uniform(-WIDTH, WIDTH, (runs or (QUICK_RUNS if quick else RUNS), 2))
    starts = np.concatenate([[rosenbrock.START], random])
    settings = QUICK_OTHERS if quick else tuple(OTHERS)
    with jax.enable_x64(True):
        found: Found = {name: filtered(method, starts, NOISE, DRIFT) for name, (method, _) in FILTERS.items()}
        found |= {name: [search(start) for start in starts] for name, (search, _) in SEARCHES.items()}
        others = {name: filtered(FILTERS[UKF][0], starts, *OTHERS[name]) for name in settings}
    caption = (
        "Left: paths from Rosenbrock's start. Middle: f on the way. Right: values and derivatives until f ≤ 1e-12, "
        "from random starts (dots) and from Rosenbrock's (crosses); what has no dots does not get there."
    )
    return publish(
        out,
        "Rosenbrock's valley: parameters of an error whose target is zero",
        claim(found),
        findings(found, others),
        rows(found, others),
        [Picture("rosenbrock", caption, valley({name: found[name] for name in SHOWN}, found))],
    )


def rows(found: Found, others: Found) -> list[Row]:
    """The numbers."""
    classical = [
        Row("rosenbrock", f"{quantity} to f ≤ 1e-12 from (−1.2, 1)", name, None, of(searches[0]), None, 1, NOTES[name])
        for quantity, of in QUANTITIES.items()
        for name, searches in found.items()
        if _told(quantity, searches)
    ]
    tenth = [
        Row("rosenbrock", "f after 10 updates from (−1.2, 1)", name, None, float(found[name][0].costs[10]), None, 1)
        for name in FILTERS
    ]
    random = [
        _over(f"{quantity} to f ≤ 1e-12 from random starts", name, searches[1:], of)
        for quantity, of in QUANTITIES.items()
        for name, searches in found.items()
        if _told(quantity, searches)
    ]
    varied = [
        _over(f"iterations to f ≤ 1e-12 from random starts, {UKF}", name, searches[1:], QUANTITIES["iterations"])
        for name, searches in others.items()
    ]
    return [*classical, *tenth, *random, *varied]


def _told(quantity: str, searches: list[Search]) -> bool:
    """Whether there is something to say: no iterations of what works by differences, no derivatives where none are."""
    if quantity == "iterations":
        return len(searches[0].path) > 1
    return quantity == "values" or any(s.derivatives > 0 for s in searches)


def _over(quantity: str, name: str, searches: list[Search], of: Callable[[Search], float]) -> Row:
    samples = np.array([of(s) for s in searches])
    mean, reached = mean_of(samples), np.isfinite(samples)
    note = f"{reached.sum()} of {len(samples)} starts get there"
    note += f", in at most {samples[reached].max():g}" if reached.any() else ""
    if not reached.all():
        note += f"; least f of the others: {min(s.least for s, there in zip(searches, reached) if not there):.1g}"
    return Row("rosenbrock", quantity, name, None, mean.value, mean.spread, mean.runs, note)


def claim(found: Found) -> Claim:
    """That of the paper."""
    updates = mean_of(np.array([a.iterations - b.iterations for a, b in zip(found[UKF][1:], found["EKF"][1:])]))
    values = {
        name: mean_of(np.array([s.values for s in found[name][1:]]))
        for name in (UKF, "Levenberg-Marquardt, differences")
    }
    ukf, differences = values.values()
    return Claim(
        "EKF and UKF are indistinguishable, and comparable or superior to Levenberg-Marquardt",
        {
            f"updates of the UKF minus those of the EKF: {plus_minus(updates)}": abs(updates.value) < 1,
            f"values of the function: UKF {plus_minus(ukf)}, Levenberg-Marquardt with differences "
            f"{plus_minus(differences)}": ukf.value < COMPARABLE * differences.value,
        },
    )


def findings(found: Found, others: Found) -> Sequence[str]:
    """What became of the paper's claims, in words."""
    first = {name: searches[0] for name, searches in found.items()}
    values = {name: mean_of(np.array([s.values for s in searches[1:]])) for name, searches in found.items()}
    apart = mean_of(np.array([a.iterations - b.iterations for a, b in zip(found[UKF][1:], found["EKF"][1:])]))
    varied = {name: np.mean([s.iterations for s in searches[1:]]) for name, searches in others.items()}
    reached = {name: value for name, value in varied.items() if np.isfinite(value)}  # from every start
    quick, slow = min(reached, key=lambda name: reached[name]), max(reached, key=lambda name: reached[name])
    lost = [name for name in varied if name not in reached]
    ukf, lm, quasi, differences = (
        first[name] for name in (UKF, "Levenberg-Marquardt", "BFGS", "Levenberg-Marquardt, differences")
    )
    return (
        f'"Comparable or superior": from (−1.2, 1) the UKF needs {ukf.iterations:g} updates, {ukf.values:g} values in '
        f"all; Levenberg-Marquardt {lm.values:g} values and {lm.derivatives:g} Jacobians, or {differences.values:g} "
        f"values with differences; BFGS {quasi.values:g} values and {quasi.derivatives:g} gradients.",
        f"From random starts, without derivatives: {values[UKF].value:.1f} ± {values[UKF].spread:.1f} values by the "
        f"UKF, {values['Levenberg-Marquardt, differences'].value:.1f} ± "
        f"{values['Levenberg-Marquardt, differences'].spread:.1f} by Levenberg-Marquardt. With Jacobians: "
        f"{values['EKF'].value:.1f} by the EKF, {values['Levenberg-Marquardt'].value:.1f} by Levenberg-Marquardt. BFGS "
        f"with gradients: {values['BFGS'].value:.1f}.",
        f'"Indistinguishable": updates of the UKF minus those of the EKF are {apart.value:+.2f} ± {apart.spread:.2f}.',
        "With noise small beside the drift an update is nearly a Gauss-Newton step, which this valley suits. How fast "
        f"it is depends on both: from {reached[quick]:.1f} updates ({quick}) to {reached[slow]:.1f} ({slow})"
        + (f"; not from every start in {UPDATES}: {', '.join(lost)}." if lost else "."),
        f"Option 1, the mean output, ends at f = {found['SR-UKF'][0].costs[-1]:.2g}: its 10 (x₂ − x₁²) is less "
        "by ten times the variance of x₁, which the drift keeps up.",
    )
