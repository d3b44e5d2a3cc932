"""Particle filters with proposals of Kalman filters on a gamma-driven autoregression with sharp sensors.

Published (Wan & van der Merwe 2001, section 7.6.2, Table 7.1, Figure 7.20): mean and variance over 100 runs of what is
called the mean square error, for 200 particles and residual resampling. "The superior performance of the unscented
particle filter (UPF) is clearly evident." The scores are root mean square errors. Printed are the parameters of the
UKF; the others are those of the program of N. de Freitas and R. van der Merwe (17 August 2000), of which copies are
public: Gaussian filters start from N(1, 3/4) and take the process noise to have variance 3/4 but no mean, which is 3/2;
proposals have a Q of 7.5 (EKF) or 1.5 (UKF) and an R of 0.1; the MCMC step is one to a fresh draw of the proposal. (Its
proposals are weighed by the gamma density of x[t] − x[t−1]; here it is that of the noise.)

And 1e-99 is added to every likelihood, against division by zero. A measurement 22 standard deviations off is worth as
much, or 0.03 to 0.14 in x. Where no particle of 200 comes as near, all weigh the same. With logarithms of weights the
nearest wins, and there is nothing to divide by zero. So here are three tables: as published; with logarithms; and with
filters that know the mean of the noise as well, which is the problem as it was posed.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

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
)
from sigmapoint.experiments.upf_synthetic.figures import estimates, scores
from sigmapoint.experiments.upf_synthetic.runs import Case, Found, Series, cases, found, series
from sigmapoint.problems import gamma_autoregression as problem

RUNS, QUICK_RUNS = 100, 10
QUICK = ("EKF", "UKF", "iterated EKF", "PF", "UPF")
PUBLISHED = {
    "EKF": (0.374, 0.015),
    "UKF": (0.280, 0.012),
    "PF": (0.424, 0.053),
    "PF+MCMC": (0.417, 0.055),
    "PF-EKF": (0.310, 0.016),
    "PF-EKF+MCMC": (0.307, 0.015),
    "UPF": (0.070, 0.006),
    "UPF+MCMC": (0.074, 0.008),
}
"""Mean and variance in Table 7.1."""
DRAWN = ("PF", "PF-EKF", "UPF")
"""in Figure 7.20"""

Results = Sequence[tuple[Case, Mapping[str, Found]]]


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    with jax.enable_x64(True):
        for_series, for_filters = jax.random.split(jax.random.key(seed))
        drawn = series(jax.random.split(for_series, runs or (QUICK_RUNS if quick else RUNS)))
        results = [
            (case, {
                name: found(case, method, drawn, for_filters)
                for name, (method, _) in case.methods.items() if name in QUICK or not quick
            })
            for case in cases()[: 2 if quick else None]
        ]  # fmt: skip
        least = inverted(drawn)
    return publish(
        out,
        "The unscented particle filter on a gamma-driven autoregression",
        claim(results),
        findings(results, least),
        [*rows(results), _row("by solving y = h(x) for x > 0", "no filter", least)],
        pictures(results, drawn, least),
    )


def inverted(drawn: Series) -> Mean:
    """Error of the state that would show the measurement without noise."""
    return mean_of(np.sqrt((np.asarray(problem.inverted(drawn.y) - drawn.x)[:, 1:, 0] ** 2).mean(1)))


def spread_of(rmse: np.ndarray) -> Mean:
    """Variance over the runs, with its standard error."""
    return mean_of((rmse - rmse.mean()) ** 2 * rmse.size / (rmse.size - 1))


def rows(results: Results) -> list[Row]:
    """The numbers, those of the published table first."""
    said = []
    for case, by in results:
        published = PUBLISHED if case is results[0][0] else {}
        notes = {name: _note(case.methods[name][1], one.unexplained) for name, one in by.items()}
        for i, (quantity, of) in enumerate((("mean over runs", mean_of), ("variance over runs", spread_of))):
            column = {name: both[i] for name, both in published.items()}
            said += [
                _row(f"RMSE, {quantity}, {case.name}", name, of(one.rmse), notes[name], column.get(name))
                for name, one in by.items()
            ]
    return said


def _note(settings: str, unexplained: int) -> str:
    return "; ".join(filter(None, (settings, f"no particle possible at {unexplained} steps" if unexplained else "")))


def _row(quantity: str, method: str, mean: Mean, note: str = "", published: float | None = None) -> Row:
    return Row("upf-synthetic", quantity, method, published, mean.value, mean.spread, mean.runs, note)


def claim(results: Results) -> Claim:
    """Table 7.1, and what is said of it."""
    table = results[0][1]
    means, far = {name: mean_of(one.rmse) for name, one in table.items()}, distant(table)
    gain = ahead(table["PF"].rmse, table["UPF"].rmse)
    return Claim(
        "Table 7.1; the superior performance of the UPF is clearly evident",
        {
            f"{name} {plus_minus(mean)} (published {PUBLISHED[name][0]:.3f})": name not in far
            for name, mean in means.items()
        }
        | {f"UPF below PF by {plus_minus(gain)}": positive(gain)},
    )


def findings(results: Results, least: Mean) -> Sequence[str]:
    """What came out, in words."""
    table, logarithms = results[0][1], results[1][1]
    return (
        printed(table),
        f'"The superior performance of the UPF is clearly evident", its error below that of the PF: as published '
        f"{_gain(table)}; with logarithms of weights {_gain(logarithms)}.",
        f"What puts the published PF last is 1e-99, added to every likelihood: where no particle comes near the "
        f"measurement, all weigh the same. With logarithms of weights the same PF has {_mean(logarithms, 'PF')}.",
        f"Solving y = h(x) for the state, without any filter, has an RMSE of {least.value:.4f} ± {least.spread:.4f}: "
        "nothing but the noise of the sensor is left. An EKF that iterates its update has "
        f"{_mean(logarithms, 'iterated EKF')}, without particles, and without the mean of the noise. This problem asks "
        "for a careful update, not for particles.",
        *(told(by) for _, by in results[2:]),
    )


def distant(table: Mapping[str, Found]) -> list[str]:
    """Methods further from the printed number than three standard errors and 10 %."""
    means = {name: mean_of(one.rmse) for name, one in table.items()}
    off = {name: abs(mean.value - PUBLISHED[name][0]) for name, mean in means.items()}
    return [name for name, mean in means.items() if off[name] > 3 * mean.spread + 0.1 * PUBLISHED[name][0]]


def printed(table: Mapping[str, Found]) -> str:
    """What became of Table 7.1."""
    means = {name: mean_of(one.rmse) for name, one in table.items()}
    far = distant(table)
    numbers = ", ".join(f"{name} {mean.value:.3f} ({PUBLISHED[name][0]:.3f})" for name, mean in means.items())
    verdict = f"not reproduced: {', '.join(far)}" if far else "reproduced"
    return f"Table 7.1, mean RMSE measured (published): {numbers}. Within three standard errors and 10 %: {verdict}."


def told(by: Mapping[str, Found]) -> str:
    """The same, where filters know the mean of the noise."""
    numbers = ", ".join(f"{name} {mean_of(one.rmse).value:.4f}" for name, one in by.items())
    return f"Told the mean of the noise as well, the problem as it was posed: {numbers}; UPF below PF {_gain(by)}."


def _mean(by: Mapping[str, Found], name: str) -> str:
    return f"{mean_of(by[name].rmse).value:.4f}"


def _gain(by: Mapping[str, Found]) -> str:
    """By how much the UPF is better than the PF on the same series."""
    gain = ahead(by["PF"].rmse, by["UPF"].rmse)
    return f"by {gain.value:.3f} ± {gain.spread:.3f}, {decided(gain)}"


def pictures(results: Results, drawn: Series, least: Mean) -> Sequence[Picture]:
    """Figure 7.20, and all scores."""
    case, by = results[0]
    return (
        Picture(
            "upf-synthetic-run",
            f"The first run, {case.name}: the state and its estimates above, errors below (Figure 7.20).",
            estimates(np.asarray(drawn.x)[0, :, 0], {name: by[name].mean[0] for name in DRAWN if name in by}),
        ),
        Picture(
            "upf-synthetic-scores",
            "RMSE, mean over the runs ± 2 standard errors; crosses: published. Dotted: solving y = h(x) for x.",
            scores(
                {case.name: {name: mean_of(one.rmse) for name, one in by.items()} for case, by in results},
                {name: mean for name, (mean, _) in PUBLISHED.items()}, least.value,
            ),
        ),
    )  # fmt: skip
