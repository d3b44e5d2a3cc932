"""Time against the number of states, the length of a series and the number of series, for every library."""

from pathlib import Path
from typing import Any

import numpy as np

NAMES = {"kalman_py": "kalman-py", "stonesoup": "Stone Soup", "eigen": "C++ with Eigen"}
COLOURS = {
    "sigmapoint": "#0072b2",
    "eigen": "#000000",
    "dynamax": "#d55e00",
    "kalman_py": "#009e73",
    "cuthbert": "#cc79a7",
    "smcx": "#e69f00",
}
STYLES = {"ukf": "-o", "srukf": "--s", "srekf": ":^", "ekf": "-.v"}
SUBJECTS = {
    "states": ("states", "microseconds a step", lambda row: int(row["problem"].partition("-")[2])),
    "length": ("rows of the series", "microseconds a step", lambda row: row["rows"]),
    "batch": ("series of 200 rows", "microseconds a step of one series", lambda row: row["series"]),
}


def drawn(rows: list[dict[str, Any]], folder: Path) -> None:
    """One figure for each subject that was measured: states.svg, length.svg, batch.svg."""
    import matplotlib.pyplot as plt

    for part, (along, up, size) in SUBJECTS.items():
        given = [row for row in rows if _belongs(row, part) and "error" not in row]
        lines: dict[tuple[str, str], list[tuple[int, list[float]]]] = {}
        for row in given:
            lines.setdefault((row["contender"], row["method"]), []).append((size(row), row["us_per_step"]))
        lines = {key: points for key, points in lines.items() if len(points) > 1}
        if not lines:
            continue
        figure, ax = plt.subplots(figsize=(8.5, 5), layout="constrained")
        for (name, method), points in lines.items():
            points.sort()
            x = [at for at, _ in points]
            low, middle, high = np.array([np.quantile(times, [0.25, 0.5, 0.75]) for _, times in points]).T
            label = f"{NAMES.get(name, name)} {method}"
            own = 2.2 if name == "sigmapoint" else 1.1
            (line,) = ax.loglog(x, middle, STYLES[method], color=COLOURS[name], ms=4, lw=own, label=label)
            ax.fill_between(x, low, high, color=line.get_color(), alpha=0.2, lw=0)
        ax.set_xlabel(along)
        ax.set_ylabel(up)
        if part == "states":
            ax.set_xticks(sorted({size(row) for row in given}), minor=False)
            ax.xaxis.set_major_formatter("{x:g}")
            ax.xaxis.set_minor_locator(plt.NullLocator())
        ax.grid(alpha=0.25)
        ax.spines[["top", "right"]].set_visible(False)
        figure.legend(loc="outside right upper", frameon=False, fontsize="small")
        figure.savefig(folder / f"{part}.svg")
        figure.savefig(folder / f"{part}.png", dpi=160)
        plt.close(figure)


def _belongs(row: dict[str, Any], part: str) -> bool:
    # The turn at 100,000 rows is one point of the lengths, measured once.
    shared = part == "length" and row["part"] == "turn" and row["rows"] == 100_000 and row["method"] == "ukf"
    return row["part"] == part or shared
