"""A chaotic series through noise of half its power, with a network for its dynamics: six filters, and their time.

Mackey-Glass with a delay of 30 (`problems.mackey_glass`), a 6-10-1 network trained on the clean series, measurement
noise of 3 dB. Published as a curve of one stretch, without numbers: van der Merwe & Wan, "The square-root unscented
Kalman filter" (2001), Figure 2, and Wan & van der Merwe (2001), Figure 7.6. In words: the SR-UKF and the UKF cannot be
told apart and are both superior to the EKF; the SR-UKF is about 20 % faster than the UKF and about 10 % faster than the
EKF. Lengths are not given; ours: a network trained on 1000 samples, and for every run 300 others with a noise of their
own.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import sigmapoint as sp
from sigmapoint.experiments.mackey_glass.figures import scores, stretch
from sigmapoint.experiments.publishing.results import (
    Claim,
    Mean,
    Picture,
    Row,
    ahead,
    decided,
    mean_of,
    plus_minus,
    positive,
    publish,
    row_of,
)
from sigmapoint.filtering import scan
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel
from sigmapoint.problems import mackey_glass, noisy_series
from sigmapoint.problems.autoregression import normalized
from sigmapoint.problems.noisy_series import NOISE, learned
from sigmapoint.step import Filter
from sigmapoint.timing import in_turn

SIZES = (6, 10, 1)
METHODS: dict[str, tuple[Method, str]] = {
    "EKF": (sp.ekf(), ""),
    "UKF": (sp.ukf(), "α=1, β=2, κ=0"),
    "SR-UKF": (sp.srukf(), "α=1, β=2, κ=0"),
    "CDKF": (sp.cdkf(), "h = √3"),
    "SR-CDKF": (sp.srcdkf(), "h = √3"),
    "GHKF(3)": (sp.ghkf(3), "729 points"),
}
QUICK = ("EKF", "UKF", "SR-UKF")
PUBLISHED = {"UKF": 0.8, "EKF": 0.9}
"""time of a step of the SR-UKF over that of these"""
TRAIN, TEST = 1000, 300
EPOCHS, QUICK_EPOCHS = 20, 3
RUNS, QUICK_RUNS = 100, 4
SETTLED = 10
"""samples at first that no filter is judged by"""
REPETITIONS, LONG = 15, 10_000
"""timings of each method, in turn, and the samples of one"""
UNTIMED = ("GHKF(3)",)
"""some hundred times the others"""
SAME = 1e-6
"""relative to the deviation of the series, by which two forms of one filter may differ"""

_row = partial(row_of, "mackey-glass")


class Found(NamedTuple):
    """What became of each method."""

    mean: Mapping[str, Float[np.ndarray, "R T"]]
    clean: Float[np.ndarray, "R T"]
    noisy: Float[np.ndarray, "R T"]
    seconds: Mapping[str, Float[np.ndarray, " K"]]
    """of a step, each time it was taken"""

    def errors(self, name: str) -> Float[np.ndarray, " R"]:
        """Normalised mean squared error of each run."""
        off = (self.mean[name] - self.clean)[:, SETTLED:] ** 2
        return off.mean(1) / self.clean[:, SETTLED:].var(1)

    def gain(self, worse: str, better: str) -> Mean:
        """How much lower one error is than another, run by run."""
        return ahead(self.errors(worse), self.errors(better))


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    with jax.enable_x64(True):
        found = measured(runs or (QUICK_RUNS if quick else RUNS), seed, quick)
    first = (
        "One stretch: the clean series, its measurements, and the estimates of the EKF and the SR-UKF; below, errors."
    )
    every = "Normalised mean squared error, mean over runs ± standard error; and time of a step, medians and quartiles."
    pictures = [
        Picture("mackey-glass", first, stretch(found.clean[0], found.noisy[0], found.mean)),
        Picture("mackey-glass-errors", every, scores({n: mean_of(found.errors(n)) for n in found.mean}, found.seconds)),
    ]
    return publish(out, "A chaotic series through noise", claim(found), findings(found), rows(found), pictures)


def measured(runs: int, seed: int, quick: bool) -> Found:
    """Every method on other parts of the series, each with a noise of its own."""
    keys = jax.random.split(jax.random.key(seed))
    whole = normalized(mackey_glass.series(TRAIN + runs * TEST))
    known = learned(SIZES, whole[:TRAIN], QUICK_EPOCHS if quick else EPOCHS, keys[0])
    model = noisy_series.model(*known, jnp.asarray(NOISE), noisy_series.stationary(whole[:TRAIN], SIZES[0]))
    clean = whole[TRAIN:].reshape(runs, TEST)
    noisy = clean + NOISE**0.5 * jax.random.normal(keys[1], clean.shape)
    chosen = {name: METHODS[name][0] for name in (QUICK if quick else METHODS)}
    mean = {name: np.asarray(jax.lax.map(partial(filtered, model, method), noisy)) for name, method in chosen.items()}
    return Found(mean, np.asarray(clean), np.asarray(noisy), timed(model, noisy.reshape(-1), chosen, quick))


@eqx.filter_jit
def filtered(model: StateSpaceModel, method: Method, y: Float[Array, " T"]) -> Float[Array, " T"]:
    """The estimate of every sample."""
    return scan(Filter.of(model, method), y[:, None], None, lambda state, _: state.belief.mean[0])[0]


def timed(
    model: StateSpaceModel, y: Float[Array, " T"], chosen: Mapping[str, Method], quick: bool
) -> dict[str, Float[np.ndarray, " K"]]:
    """Seconds of a step of all methods in turn, compiled before."""
    y = y[:LONG]
    programs = {name: partial(filtered, model, method, y) for name, method in chosen.items() if name not in UNTIMED}
    taken = in_turn(programs, 2 if quick else REPETITIONS)
    return {name: seconds / len(y) for name, seconds in taken.items()}


def apart(found: Found) -> dict[str, float]:
    """The largest difference of a square-root filter's estimates from those of its dense form."""
    pairs = {name: name.removeprefix("SR-") for name in found.mean if name.startswith("SR-")}
    return {name: float(np.abs(found.mean[name] - found.mean[dense]).max()) for name, dense in pairs.items()}


class Ratio(NamedTuple):
    """Of times, over repetitions."""

    low: float
    median: float
    high: float
    """low and high: quartiles"""
    repetitions: int

    @classmethod
    def of(cls, found: Found, other: str) -> "Ratio":
        """Time of the SR-UKF over that of another filter."""
        each = found.seconds["SR-UKF"] / found.seconds[other]
        low, median, high = map(float, np.quantile(each, [0.25, 0.5, 0.75]))
        return cls(low, median, high, len(each))

    def __str__(self) -> str:
        return f"{self.median:.2f} (middle half {self.low:.2f} to {self.high:.2f})"


def rows(found: Found) -> list[Row]:
    """The numbers."""
    ratios = {other: Ratio.of(found, other) for other in PUBLISHED}
    return [
        *(_row("normalised MSE", name, mean_of(found.errors(name)), METHODS[name][1]) for name in found.mean),
        *(_row("normalised MSE, EKF minus this, run by run", name, found.gain("EKF", name))
          for name in found.mean if name != "EKF"),
        *(Row("mackey-glass", "largest difference from the dense form", name, None, value, None, found.clean.size)
          for name, value in apart(found).items()),
        *(Row("mackey-glass", "time of a step [µs]", name, None, 1e6 * float(np.median(one)), None, len(one), "median")
          for name, one in found.seconds.items()),
        *(Row("mackey-glass", "time of a step of the SR-UKF over that of this", other, PUBLISHED[other], r.median, None,
              r.repetitions, f"median; middle half {r.low:.2f} to {r.high:.2f}") for other, r in ratios.items()),
    ]  # fmt: skip


def claim(found: Found) -> Claim:
    """That about errors, and that about times, which other programs on other machines have."""
    furthest, gains = max(apart(found).values()), {name: found.gain("EKF", name) for name in ("UKF", "SR-UKF")}
    return Claim(
        "SR-UKF and UKF cannot be told apart, and are both superior to the EKF; the SR-UKF is the fastest",
        {f"estimates of square-root and dense form differ by at most {furthest:.1e}": furthest < SAME}
        | {f"{name} below the EKF by {plus_minus(gain)}": positive(gain) for name, gain in gains.items()}
        | {
            f"a step of the SR-UKF takes {one} of the time of the {other} (published: {published:g})": one.high < 1
            for (other, published), one in zip(PUBLISHED.items(), (Ratio.of(found, other) for other in PUBLISHED))
        },
    )


def findings(found: Found) -> Sequence[str]:
    """What became of the claims, in words."""
    score = {name: mean_of(found.errors(name)) for name in found.mean}
    listed = "; ".join(f"{name} {m.value:.3f} ± {m.spread:.3f}" for name, m in score.items())
    below = {name: found.gain("EKF", name) for name in ("UKF", "SR-UKF")}
    lower = ", ".join(f"{name} {decided(m)} (by {m.value:.3f} ± {m.spread:.3f})" for name, m in below.items())
    furthest = max(apart(found).values())
    same = "reproduced" if furthest < SAME else "not reproduced"
    times = "; ".join(
        f"{Ratio.of(found, other)} of the time of the {other} (published: {one:g})" for other, one in PUBLISHED.items()
    )
    return (
        f"Normalised mean squared errors over {len(found.clean)} runs: {listed}. The noise itself has {NOISE:.2f}.",
        f"Same performance of SR-UKF and UKF: {same}, their estimates differ by at most {furthest:.1e}. Below the EKF: "
        f"{lower}.",
        f"A step of the SR-UKF takes {times}. The papers compare programs of an interpreted language, in which a step "
        "costs what its calls cost. Here each filter is one compiled function: the EKF needs one value of the network "
        "with its derivatives where sigma-point filters need 13 values, and square-root forms turn the points by "
        "reflections where dense ones multiply them. What the square root gives is a covariance that cannot lose its "
        "definiteness.",
    )
