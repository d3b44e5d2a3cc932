"""Capacity and series resistance of a Nissan Leaf cell at 10, 25 and 40 °C, estimated with its state of charge.

Not from the papers. Each run is estimated by a cell that was identified from the other two; capacity and resistance
start at random up to 20 % wrong, the state of charge up to 10 points. The capacity is held against the counted charge
of the run itself, from full to empty: within 3 %, and inside its 95 % interval. The data are the same in all runs of a
temperature; the spread is that over starts.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import sigmapoint as sp
from sigmapoint.data import TEMPERATURES
from sigmapoint.experiments.battery_joint.figures import errors, tracks
from sigmapoint.experiments.publishing.results import Claim, Mean, Picture, Row, mean_of, publish, row_of
from sigmapoint.methods import Method
from sigmapoint.problems import battery, battery_joint
from sigmapoint.problems.battery_evaluation import SETTLED
from sigmapoint.problems.battery_joint import Held, Unknown

METHODS = {"SR-CDKF": sp.srcdkf(), "SR-UKF": sp.srukf(), "EKF": sp.ekf()}
SHOWN = "SR-CDKF"
RUNS, QUICK_RUNS = 20, 2
QUICK_TEMPERATURES = (25,)
WRONG, WRONG_SOC = 0.2, 0.1
"""[of the true value] capacity and resistance start within ± this, all equally likely; [1] the state of charge"""
DRIFT = Unknown(0.0, 1e-5)
"""variance that each gains in a step, of that of the prior: the resistance changes along the state of charge (0 and
1e-6 were tried, too: the capacity ends within 0.2 % of the same)"""
CLOSE = 3.0
"""[%] of the counted capacity"""


class Found(NamedTuple):
    """One row a start, one column a sample."""

    capacity: np.ndarray
    """[Ah]"""
    capacity_low: np.ndarray
    capacity_high: np.ndarray
    """[Ah] where the 95 % interval begins and ends"""
    r0: np.ndarray
    """[Ω]"""
    r0_low: np.ndarray
    r0_high: np.ndarray
    """[Ω] likewise"""
    soc: np.ndarray
    """[1]"""


Case = dict[str, Found]
_row = partial(row_of, "battery-joint")


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    temperatures = QUICK_TEMPERATURES if quick else TEMPERATURES
    methods = {SHOWN: METHODS[SHOWN]} if quick else METHODS
    with jax.enable_x64(True):
        cells = {t: battery_joint.held(t) for t in temperatures}
        wrong = jax.random.uniform(
            jax.random.key(seed), (runs or (QUICK_RUNS if quick else RUNS), 3), minval=-1.0, maxval=1.0
        )
        found = {t: {name: estimated(held, m, wrong) for name, m in methods.items()} for t, held in cells.items()}
    return publish(
        out,
        "Capacity and resistance of a real cell, estimated with its state of charge",
        claim(cells, found),
        findings(cells, found),
        rows(cells, found),
        [
            Picture(
                "battery-joint-estimates",
                f"Capacity (above) and series resistance (below) by the {SHOWN}, each with its 95 % interval, from the "
                "start of the run whose capacity is furthest off; dotted: another start. Black: capacity by counted "
                "charge, jumps of the voltage over jumps of the current.",
                tracks(cells, {t: case[SHOWN] for t, case in found.items()}),
            ),
            Picture(
                "battery-joint-error",
                "Error of the capacity, all starts; dashed: 3 %. Shaded: the 95 % interval of the first start.",
                errors(cells, {t: case[SHOWN] for t, case in found.items()}, CLOSE),
            ),
        ],
    )


def estimated(run: Held, method: Method, wrong: Float[Array, "R 3"]) -> Found:
    """The whole run from several starts; `wrong` in [−1, 1]: errors of capacity, resistance, state of charge."""
    truth = Unknown(run.counted, float(np.median(battery_joint.jumps(run.log)[1])))

    def one(wrong: Float[Array, " 3"]) -> tuple[Any, ...]:
        theta = Unknown(*(sp.positive(v * (1 + WRONG * w), v * WRONG) for v, w in zip(truth, wrong[:2])))
        first = run.reference[0] + WRONG_SOC * wrong[2]
        model = sp.joint(lambda theta: battery_joint.model(run, theta, first, WRONG_SOC), theta, drift=jnp.array(DRIFT))
        post = sp.filter(model, run.y, run.u, method=method, keep=("mean", "std"))
        found = sp.estimates(theta, post)
        soc = jnp.asarray(post.mean)[:, 0]
        bands = (found.value, found.low, found.high)
        return *(part.capacity for part in bands), *(part.r0 for part in bands), soc

    return Found(*map(np.asarray, jax.jit(jax.vmap(one))(wrong)))


def rows(cells: Mapping[int, Held], found: Mapping[int, Case]) -> list[Row]:
    """The numbers."""

    def each(quantity: str, of: Any, note: str = "") -> list[Row]:
        return [
            _row(f"{quantity}, {t} °C", name, of(cells[t], one), note)
            for t, case in found.items()
            for name, one in case.items()
        ]

    def full(held: Held, one: Found) -> Mean:
        row = battery.anchor(held.log)
        return mean_of(100 * np.abs(one.capacity[:, row] / held.counted - 1))

    return [
        *each("error of the capacity at the end, % of the counted one", lambda h, f: mean_of(off(h, f)),
              f"wanted: {CLOSE:g} or less; starts up to {100 * WRONG:g} % off"),
        *each("capacity over the counted one", lambda h, f: mean_of(f.capacity[:, -1] / h.counted)),
        *each("counted capacity inside the 95 % interval at the end, share of starts",
              lambda h, f: mean_of(inside(h, f)[:, -1])),
        *each("the same, share of the samples from half an hour on", lambda h, f: mean_of(late(h, f))),
        *each("half width of the 95 % interval at the end, %", lambda h, f: mean_of(width(h, f))),
        *each("error of the capacity when the cell is first full, %", full, "before the discharge that is counted"),
        *each("series resistance over jumps of voltage by current, median over jumps",
              lambda h, f: mean_of(resistance(h, f)), "a jump within 0.5 to 1 s has a little of the fast pair in it"),
        *each("median jump inside the 95 % interval of the resistance, share of the samples after the full charge",
              lambda h, f: mean_of(resistance_inside(h, f)[0])),
        *each("the same before, without a jump of the current but that at the start",
              lambda h, f: mean_of(resistance_inside(h, f)[1]),
              "probably an error of the table, near empty, passes for one of the resistance; tried: an unknown factor "
              "on the RC pairs, which does not mend it"),
        *each("error of the state of charge from half an hour on, rms in points", lambda h, f: mean_of(points(h, f))),
    ]  # fmt: skip


def off(held: Held, found: Found) -> Float[np.ndarray, " R"]:
    """[%] how far the last capacity is from the counted one."""
    return 100 * np.abs(found.capacity[:, -1] / held.counted - 1)


def inside(held: Held, found: Found) -> Float[np.ndarray, "R T"]:
    """1 where the counted capacity is in the interval."""
    return 1.0 * ((found.capacity_low <= held.counted) & (held.counted <= found.capacity_high))


def width(held: Held, found: Found) -> Float[np.ndarray, " R"]:
    """[%] half of the last interval."""
    return 50 * (found.capacity_high - found.capacity_low)[:, -1] / held.counted


def late(held: Held, found: Found) -> Float[np.ndarray, " R"]:
    """Share of time, of samples, that the counted capacity is inside."""
    return inside(held, found)[:, _settled(held)].mean(1)


def points(held: Held, found: Found) -> Float[np.ndarray, " R"]:
    """[points] rms error of the state of charge."""
    error = found.soc - held.reference
    return 100 * np.sqrt((error[:, _settled(held)] ** 2).mean(1))


def resistance(held: Held, found: Found) -> Float[np.ndarray, " R"]:
    """Estimated over seen, at the jumps of the current after half an hour."""
    at, seen = battery_joint.jumps(held.log)
    kept = _settled(held)[at]
    return np.median(found.r0[:, at[kept]] / seen[kept], axis=1)


def resistance_inside(held: Held, found: Found) -> tuple[Float[np.ndarray, " R"], Float[np.ndarray, " R"]]:
    """Share of the samples, after and before the end of the full charge, that have the median jump inside."""
    seen, full = np.median(battery_joint.jumps(held.log)[1]), battery.anchor(held.log)
    there = (found.r0_low <= seen) & (seen <= found.r0_high)
    return there[:, full:].mean(1), there[:, _settled(held)][:, : full - int(np.argmax(_settled(held)))].mean(1)


def _settled(held: Held) -> np.ndarray:
    return held.log.time - held.log.time[0] >= SETTLED


def claim(cells: Mapping[int, Held], found: Mapping[int, Case]) -> Claim:
    """Ours: the papers have no battery."""
    worst = max(float(off(cells[t], one).max()) for t, case in found.items() for one in case.values())
    return Claim(
        f"(ours) the capacity is found within {CLOSE:g} % of the counted one, from any start and by every method",
        {f"the worst is {worst:.2f} % off": worst <= CLOSE},
    )


def findings(cells: Mapping[int, Held], found: Mapping[int, Case]) -> Sequence[str]:
    """What came out, in words."""
    shown = {t: case[SHOWN] for t, case in found.items()}
    worst = {(t, name): float(off(cells[t], one).max()) for t, case in found.items() for name, one in case.items()}
    furthest = max(worst, key=lambda which: worst[which])
    covered = min(inside(cells[t], one)[:, -1].mean() for t, case in found.items() for one in case.values())
    said = "; ".join(
        f"{t} °C {mean_of(one.capacity[:, -1]).value:.2f} Ah ± {mean_of(width(c, one)).value:.1f} % (counted "
        f"{c.counted:.2f} Ah)"
        for (t, one), c in zip(shown.items(), cells.values())
    )
    ratio = "; ".join(f"{t} °C {mean_of(resistance(cells[t], one)).value:.3f}" for t, one in shown.items())
    bars = "; ".join(
        f"{t} °C {after.mean():.0%} and {before.mean():.0%}"
        for t, (after, before) in ((t, resistance_inside(cells[t], one)) for t, one in shown.items())
    )
    verdict = "reached" if worst[furthest] <= CLOSE else "missed"
    return (
        f"Capacity within {CLOSE:g} % of the counted one: {verdict}. Of all starts, methods and temperatures the worst "
        f"is {worst[furthest]:.2f} % off ({furthest[1]}, {furthest[0]} °C).",
        f"Capacity by the {SHOWN} with its 95 % interval: {said}. The counted one is inside for at least "
        f"{covered:.0%} of the starts, of every method and temperature.",
        f"Series resistance over what jumps of the current show, without a model: {ratio}. Extrapolated from the other "
        "temperatures it would be "
        + "; ".join(f"{t} °C {c.cell.r0 / np.median(battery_joint.jumps(c.log)[1]):.2f}" for t, c in cells.items())
        + ".",
        "Share of the samples that have the median jump in the 95 % interval of the resistance, after the full charge "
        f"and before it: {bars}. Before, no jump of the current tells resistance and table apart. Where the interval "
        "is wrong, an error of the steep part of the curve, near empty, probably passes for resistance.",
        "Each temperature is one recording: agreement of starts says that the start is forgotten, not that another "
        "recording would give the same. By these three recordings the intervals of the capacity are rather too wide.",
    )
