"""EKF against sigma-point filters on the lecture notes' scalar model (Plett, ECE5550 chapter 6, sections 6.2 and 6.6).

The notes run either filter once for 40 steps, draw state and error with ±3σ bounds (the figures of 6.2 and 6.6), print
no number, and conclude: "Note improved estimation accuracy, greatly improved error bounds." Here: the same over many
series, with accuracy (RMSE), honesty of the bounds (share of errors within ±3σ, 0.9973 if Gaussian; mean of error²/σ²,
1 if consistent), every method on the same series, differences paired by series, and the exact answer on a grid.

Two facts about the notes' code. Its SPKF weights, W₀ = (h² − L)/h² for the mean and the covariance alike, are those of
the unscented rule with α = 1, β = 0, κ = h² − L; with h = √3 and L = 3 (x, w, v) that is κ = 0. And its loop predicts
before the first measurement, which was taken of the state that the initial belief is about: one time update too many,
once. From then on x̂ and z belong to the same state, which is row k of `xstore`, not row k+1 that is stored beside x̂.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import sigmapoint as sp
from sigmapoint.diagnosis.accuracy import coverage
from sigmapoint.experiments.publishing.results import (
    Claim,
    Mean,
    Picture,
    Row,
    ahead,
    mean_of,
    plus_minus,
    positive,
    publish,
    row_of,
)
from sigmapoint.experiments.scalar.figures import all_methods, single_run
from sigmapoint.methods import Method
from sigmapoint.problems import scalar

SPKF = "SPKF of the notes"
METHODS: dict[str, tuple[Method, str]] = {
    "EKF": (sp.ekf(), "clamped at −5 as in the notes"),
    SPKF: (sp.augmented(sp.ukf(1.0, 0.0, 0.0)), "h = √3, noises augmented: UT with α=1, β=0, κ=0, L=3"),
    "UKF": (sp.ukf(), "α=1, β=2, κ=0"),
    "CDKF": (sp.cdkf(), "h = √3"),
    "SR-CDKF": (sp.srcdkf(), "h = √3"),
    "CKF": (sp.ckf(), "two points in one dimension: a line goes through both, so curvature widens nothing"),
    "GHKF(5)": (sp.ghkf(5), "exact moments of the cubic"),
    "iterated EKF": (sp.iterated(sp.ekf(), 5), "5 passes"),
    "iterated SR-CDKF": (sp.iterated(sp.srcdkf(), 5), "5 passes, h = √3"),
}
RUNS, QUICK_RUNS = 1000, 100
LARGE = 5.0
"""An error of five standard deviations of the process noise counts as a divergence."""
BOUNDS = "share of errors within ±3σ"
NOMINAL = 0.9973


class Scores(NamedTuple):
    """One number a run, each (runs,)."""

    rmse: np.ndarray
    within: np.ndarray
    nees: np.ndarray
    largest: np.ndarray


Belief = tuple[np.ndarray, np.ndarray]
"""Means and standard deviations, each (runs, T)."""


_row = partial(row_of, "scalar")


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    with jax.enable_x64(True):
        x, z = series(runs or (QUICK_RUNS if quick else RUNS), seed)
        beliefs = {name: estimated(method, z) for name, (method, _) in METHODS.items()}
        mean, std = scalar.exact_posterior(z[..., 0])
        beliefs["exact"] = np.asarray(mean), np.asarray(std)
        late = {name: estimated(METHODS[name][0], z, early_prediction=1) for name in ("EKF", SPKF)}
    scores = {name: score(x, *belief) for name, belief in beliefs.items()}
    paired = {name: compared(scores[name], scores["EKF"]) for name in scores if name != "EKF"}
    rows = [*absolute(scores), *differences(paired), *timing(x, late, beliefs)]
    first = {name: (beliefs[name][0][0], beliefs[name][1][0]) for name in late}
    summary = {name: (mean_of(s.rmse), mean_of(s.within)) for name, s in scores.items()}
    captions = (
        "The first series, with ±3σ bounds: state above, error below; EKF (notes 6.2) and SPKF (notes 6.6).",
        f"All methods on the same {len(x)} series, mean ± 2 standard errors.",
    )
    pictures = [
        Picture("scalar-run", captions[0], single_run(x[0], first)),
        Picture("scalar-methods", captions[1], all_methods(summary, NOMINAL)),
    ]
    clamped = int((beliefs["EKF"][0] <= scalar.LOWEST).sum())
    findings = [*claims(paired), *beyond(scores), f"The EKF's clamp at −5 acted in {clamped} of {x.size:,} steps."]
    return publish(
        out, "A scalar model with a cubic sensor: EKF and sigma-point filters", claim(paired), findings, rows, pictures
    )


def series(runs: int, seed: int) -> tuple[np.ndarray, Array]:
    """True states (runs, T) and measurements (runs, T, 1)."""
    keys = jax.random.split(jax.random.key(seed), runs)
    x, z = jax.vmap(lambda key: sp.simulate(scalar.model(), scalar.STEPS, key=key))(keys)
    return np.asarray(x[..., 0]), z


def estimated(method: Method, z: Float[Array, "R T m"], early_prediction: int = 0) -> Belief:
    """Beliefs of a filter. A step without a measurement put first is the notes' early prediction."""
    z = jnp.pad(z, ((0, 0), (early_prediction, 0), (0, 0)), constant_values=jnp.nan)
    post = jax.vmap(lambda one: sp.filter(scalar.model(), one, method=method, keep=("mean", "std")))(z)
    return np.asarray(post.mean)[:, early_prediction:, 0], np.asarray(post.std)[:, early_prediction:, 0]


def score(x: np.ndarray, mean: np.ndarray, std: np.ndarray) -> Scores:
    """How far off each run is, and how far it says it may be; NaN for a run that is not finite throughout."""
    lost = np.where(np.isfinite(mean + std).all(1), 0.0, np.nan)
    found = [coverage("x", *row) for row in zip(mean - x, std)]
    rms, within, largest = (np.array(part) for part in zip(*((c.rms, c.within[2], c.largest) for c in found)))
    nees = (((mean - x) / std) ** 2).mean(1)
    return Scores(rms + lost, within + lost, nees + lost, largest + lost)


def compared(scores: Scores, reference: Scores) -> tuple[Mean, Mean]:
    """Paired differences of RMSE and of the share within bounds."""
    return ahead(scores.rmse, reference.rmse), ahead(scores.within, reference.within)


def absolute(scores: dict[str, Scores]) -> list[Row]:
    """The scores of every method."""
    notes = {name: note for name, (_, note) in METHODS.items()} | {
        "exact": "Bayes' rule on a grid: no method can have a smaller mean square error"
    }
    quantities: dict[str, Callable[[Scores], np.ndarray]] = {
        "RMSE of the state": lambda s: s.rmse,
        BOUNDS: lambda s: s.within,
        "mean of error²/σ² (NEES)": lambda s: s.nees,
    }
    rows = [_row(q, name, mean_of(of(s)), notes[name]) for q, of in quantities.items() for name, s in scores.items()]
    return rows + [_divergent(name, s) for name, s in scores.items()]


def _divergent(name: str, scores: Scores) -> Row:
    lost = int(np.isnan(scores.largest).sum())
    count = float(lost + (scores.largest > LARGE).sum())
    note = f"{lost} not finite; largest error {np.nanmax(scores.largest):.3g}. Large errors stay in all averages"
    return Row("scalar", f"divergent runs: not finite, or an error above {LARGE:g}", name, None, count, None,
               scores.largest.size, note)  # fmt: skip


def differences(paired: dict[str, tuple[Mean, Mean]]) -> list[Row]:
    """Every method against the EKF on the same series."""
    rmse = [_row("RMSE, difference to the EKF", name, d[0], _verdict(-d[0].value, d[0])) for name, d in paired.items()]
    within = [_row(f"{BOUNDS}, difference to the EKF", n, d[1], _verdict(d[1].value, d[1])) for n, d in paired.items()]
    return rmse + within


def timing(x: np.ndarray, late: dict[str, Belief], right: dict[str, Belief]) -> list[Row]:
    """What the notes' early prediction, and reading the row stored beside x̂, do to the numbers."""
    late_scores = {name: score(x, *belief) for name, belief in late.items()}
    beside = {name: score(x[:, 1:], mean[:, :-1], std[:, :-1]) for name, (mean, std) in late.items()}
    cases = {
        "corrected": ({name: score(x, *right[name]) for name in late}, "the first measurement before any prediction"),
        "as printed": (late_scores, "one prediction too many before the first measurement"),
        "as printed, one state late": (beside, "x̂ compared with xstore(k+1), which is stored beside it"),
    }
    quantities: dict[str, Callable[[Scores], np.ndarray]] = {"RMSE": lambda s: s.rmse, BOUNDS: lambda s: s.within}
    return [
        _row(f"notes' timing, {case}: {quantity}", name, mean_of(of(s)), note)
        for quantity, of in quantities.items()
        for case, (scores, note) in cases.items()
        for name, s in scores.items()
    ]


def claim(paired: dict[str, tuple[Mean, Mean]]) -> Claim:
    """That of the notes."""
    rmse, within = paired[SPKF]
    less = rmse._replace(value=-rmse.value)
    return Claim(
        "sigma-point filters improve accuracy and greatly improve the error bounds",
        {
            f"RMSE lower than the EKF's by {plus_minus(less)}": positive(less),
            f"share of errors within ±3σ higher by {plus_minus(within)}": positive(within),
        },
    )


def claims(paired: dict[str, tuple[Mean, Mean]]) -> Sequence[str]:
    """The notes' claim and what became of it, in words."""
    rmse, within = paired[SPKF]
    return (
        'The notes conclude from one run: "improved estimation accuracy, greatly improved error bounds".',
        f"Improved accuracy: {_outcome(-rmse.value, rmse)}. RMSE of the notes' SPKF minus the EKF's, on the same "
        f"{rmse.runs} series: {rmse.value:+.4f} ± {rmse.spread:.4f}.",
        f"Improved error bounds: {_outcome(within.value, within)}. Share of errors within ±3σ ({NOMINAL} if Gaussian), "
        f"SPKF minus EKF: {within.value:+.4f} ± {within.spread:.4f}.",
    )


def beyond(scores: dict[str, Scores]) -> Sequence[str]:
    """What the notes do not show, in words."""
    rmse = {name: mean_of(s.rmse).value for name, s in scores.items()}
    within = {name: mean_of(s.within).value for name, s in scores.items()}
    best = min(METHODS, key=lambda name: rmse[name])
    worst = min(METHODS, key=lambda name: within[name])
    return (
        f"Nearest to the exact posterior (RMSE {rmse['exact']:.3f}) comes the {best} with {rmse[best]:.3f} and "
        f"{within[best]:.1%} of errors within ±3σ; the notes' SPKF has {rmse[SPKF]:.3f} and {within[SPKF]:.1%}.",
        f"Least honest bounds: {worst}, with {within[worst]:.1%} of errors within ±3σ ({METHODS[worst][1]}).",
    )


def _decided(gain: float, mean: Mean, yes: str, no: str) -> str:
    """By three standard errors."""
    if abs(gain) <= 3 * mean.spread:
        return "not decided by these runs"
    return yes if gain > 0 else no


def _verdict(gain: float, mean: Mean) -> str:
    return _decided(gain, mean, "better than the EKF", "worse than the EKF")


def _outcome(gain: float, mean: Mean) -> str:
    return _decided(gain, mean, "reproduced", "contradicted")
