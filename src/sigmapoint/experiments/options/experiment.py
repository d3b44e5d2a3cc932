"""Interest rate and volatility from pairs of options on an index, and the prices of the next day.

Published (Wan & van der Merwe 2001, section 7.6.2, Table 7.2, Figures 7.21 and 7.22): one-step errors of call and put
prices over the strike, strike 2925, "over the last 100 days". Not printed are the noise, and what the errors are. With
the noise of `problems.options`, and the Euclidean norm of the errors of days 104 to 204, the table is reproduced.

A step ahead is not quite tomorrow: the filters price the options of a day knowing its index, as "trivial" does not. And
the table mixes two things. What it prints for particle filters with a proposal, a quarter of the rest, is no forecast:
such particles are drawn knowing the prices of the day. So each method has two errors here, a step ahead and having seen
the day, particles a third, as drawn, and the Gaussian filters run with the noise of the published proposals as well.

Simulated markets, another one in each run; or the real one, where `--data` names a folder with it
(`problems.options_data`), once for each method that draws nothing at random. Particle filters at the strike of the
table only: 100 particles, residual resampling at every step; what is printed of those with a proposal is the mean price
of their draws, before these are weighted. They run twice: as in the program of the authors (de Freitas & van der Merwe
2000), which adds 1e-99 to every density and has a slip in a slope (`options_runs.of_the_authors`), and exactly.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np

import sigmapoint as sp
from sigmapoint.experiments.options.figures import forecasts, smiles, states
from sigmapoint.experiments.options.runs import (
    JUDGED,
    Estimator,
    Markets,
    by_particles,
    filtered,
    loaded,
    of_the_authors,
    simulated,
)
from sigmapoint.experiments.options.table import (
    EXACT,
    KINDS,
    PROPOSING,
    SHOWN,
    TABLE,
    TRIVIAL,
    Results,
    claim,
    findings,
    rows,
)
from sigmapoint.experiments.publishing.results import Picture, publish
from sigmapoint.problems import options

UNSCENTED = sp.ukf(alpha=1.0, beta=2.0, kappa=1.0)
METHODS: dict[str, tuple[Estimator, str]] = {
    "EKF": (filtered(sp.ekf()), ""),
    "UKF": (filtered(UNSCENTED), "α=1, β=2, κ=1"),
    f"EKF, {PROPOSING}": (filtered(sp.ekf(), options.PROPOSALS), "Q = 1e-4 I, R = 1e-6 I"),
    f"UKF, {PROPOSING}": (filtered(UNSCENTED, options.PROPOSALS), "the same; α=1, β=2, κ=1"),
}
OWN = {
    "process_noise": np.diag([options.PROPOSALS.rate, options.PROPOSALS.volatility]),
    "observation_noise": options.PROPOSALS.price * np.eye(2),
}
particles = partial(sp.particle_filter, 100, resampling=sp.resampling.residual, threshold=1.0)
OF_EKF = particles(proposal=sp.proposals.carried(sp.ekf(), **OWN))
OF_UKF = particles(proposal=sp.proposals.carried(UNSCENTED, **OWN))
WIDE = "Q = 1e-4 I, R = 1e-6 I"
DRAWING: dict[str, tuple[Estimator, str]] = {
    "PF": (by_particles(particles(), of_the_authors), "100 particles, as in the authors' program"),
    "PF-EKF": (by_particles(OF_EKF, of_the_authors), f"{WIDE}, as in the authors' program"),
    "UPF": (by_particles(OF_UKF, of_the_authors), f"{WIDE}; α=1, β=2, κ=1, as in the authors' program"),
    f"PF, {EXACT}": (by_particles(particles()), "100 particles"),
    f"PF-EKF, {EXACT}": (by_particles(OF_EKF), WIDE),
    f"UPF, {EXACT}": (by_particles(OF_UKF), f"{WIDE}; α=1, β=2, κ=1"),
}
"""at the strike of the table"""
RUNS, QUICK_RUNS = 100, 4
DRAWN = 3225
"""the strike of Figure 7.22"""


def run(runs: int | None, seed: int, out: Path, quick: bool, data: Path | None = None) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    with jax.enable_x64(True):
        keys = jax.random.split(jax.random.key(seed), (runs or (QUICK_RUNS if quick else RUNS), 2))
        markets = simulated(keys[:, 0]) if data is None else loaded(data)
        found = {
            strike: {
                name: method(markets.prices(strike), markets.quotes(strike), keys[:, 1])
                for name, (method, _) in (METHODS | (DRAWING if strike == TABLE else {})).items()
            }
            for strike in markets.strikes
        }
    return publish(
        out,
        "Options on an index: rate and volatility from prices",
        claim(markets, found),
        findings(markets, found),
        rows(
            markets,
            found,
            {TRIVIAL: "the price of the day before", **{k: note for k, (_, note) in (METHODS | DRAWING).items()}},
        ),
        pictures(markets, found),
    )


def pictures(markets: Markets, found: Results) -> Sequence[Picture]:
    """Of the first market."""
    first, shown = markets.markets[0], found[DRAWN]
    where = "The FTSE-100 index" if markets.real else "The first simulated market"
    true = None if markets.real else markets.truths[0]
    each = [found[strike][SHOWN] for strike in markets.strikes]
    return (
        Picture(
            "options-forecasts",
            f"{where}, strike {DRAWN}: prices over strike with what the {SHOWN} says a day ahead, and the errors. "
            "Shaded: the days that are judged.",
            forecasts(np.asarray(markets.prices(DRAWN)[0]), shown[SHOWN].ahead[0], JUDGED, KINDS),
        ),
        Picture(
            "options-states",
            f"{where}, strike {DRAWN}: rate and volatility by the {SHOWN}, ± 2 standard deviations; the EKF dashed.",
            states(
                {name: (shown[name].mean[0], shown[name].std[0]) for name in (SHOWN, "EKF")},
                None if true is None else (true.rate, true.volatility[:, markets.strikes.index(DRAWN)]),
            ),
        ),
        Picture(
            "options-smile",
            f"{where}: volatility that each strike is priced at, by the {SHOWN}: its mean, its density, and the "
            "polynomial of fourth degree through the means. A strike off its neighbours may be mispriced, or merely "
            "uncertain, which the density shows. Dashed: the index.",
            smiles(
                markets.strikes, first.spot, np.stack([one.mean[0, :, 1] for one in each], axis=1),
                np.stack([one.std[0, :, 1] for one in each], axis=1), None if true is None else true.volatility,
            ),
        ),
    )  # fmt: skip
