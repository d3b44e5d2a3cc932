"""Time sigmapoint beside other libraries: same problems, same measurements, answers compared, repetitions alternating.

    uv run python benchmarks/run.py                                     everything, about 20 minutes on two cores
    uv run python benchmarks/run.py --only turn --contenders sigmapoint,eigen
    uv run python benchmarks/run.py --figures                           draw again what was measured

Every contender is a process of its own, in an environment that `uv` makes from the pins at the head of its file. Eigen
needs g++ and Debian's libeigen3-dev. Into the folder `--out` go results.json, table.md and figures.
"""

import argparse
import importlib.util
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from figures import NAMES, drawn
from problems import measurements

HERE = Path(__file__).parent
SAME = 1e-2
"""Answers that differ by more than this part of a mean's standard deviation over time are not of the same filter."""


class Case(NamedTuple):
    """What is timed in one go: one task on one problem, by every contender that has one of its methods for it."""

    part: str
    task: str
    problem: str
    rows: int
    entrants: dict[str, list[str]]
    series: int = 1


def cases() -> Iterator[Case]:
    """Everything that is measured, in this order."""
    many = {"sigmapoint": ["ukf"], "dynamax": ["ukf"], "smcx": ["ukf"], "kalman_py": ["ukf"]}
    quick = {**many, "dynamax": ["ukf", "ekf"], "kalman_py": ["ukf", "srukf", "ekf"], "cuthbert": ["srekf"]}
    own = {"sigmapoint": ["ukf", "cdkf", "srukf", "srcdkf", "srekf"]}
    slow = {name: ["ukf"] for name in ("sigmapoint", "filterpy", "pykalman", "stonesoup")}
    yield Case("turn", "filter", "turn", 100_000, {"eigen": ["ukf"], **quick, **own})
    yield Case("turn", "filter", "turn", 10_000, slow)
    for n in (2, 3, 4, 6, 8, 12, 16, 24, 40, 80):
        entrants = {**quick, "sigmapoint": ["ukf", "srukf", "srekf"]}
        if n > 16:  # kalman-py's square-root form takes minutes to compile
            entrants["kalman_py"] = ["ukf", "ekf"]
        yield Case("states", "filter", f"lorenz96-{n}", 20_000 if n <= 16 else 2_000, entrants)
    for rows in (1_000, 10_000, 1_000_000):
        yield Case("length", "filter", "turn", rows, {"eigen": ["ukf"], **many})
    for series in (100, 1_000, 10_000):
        entrants = {"sigmapoint": ["ukf", "srekf"], "dynamax": ["ukf"], "smcx": ["ukf"], "cuthbert": ["srekf"]}
        yield Case("batch", "batch", "turn", 200, entrants, series)
    live = {"cuthbert": ["srekf"], "kalman_py": ["ukf"], "filterpy": ["ukf"], "stonesoup": ["ukf"]}
    yield Case("online", "online", "turn", 5_000, {"sigmapoint": ["ukf", "srukf", "srekf"], **live})
    yield Case("online", "online", "turn", 100_000, {"sigmapoint": ["ukf"]})
    for problem in ("growth", "turn"):
        for particles, rows in ((1_000, 1_000), (10_000, 200)):
            method = [f"bootstrap-{particles}"]
            entrants = dict.fromkeys(("sigmapoint", "smcx", "cuthbert", "particles"), method)
            yield Case("particles", "filter", problem, rows, entrants)
    yield Case("particles", "filter", "turn", 20, {"sigmapoint": ["upf-200"], "numpy": ["upf-200"]})


class Contender:
    """A library's process, started at its first use."""

    def __init__(self, name: str):
        self.name = name
        self._process: subprocess.Popen[str] | None = None

    def ask(self, **request: str) -> dict[str, Any]:
        """One request, its answer."""
        if self._process is None:
            file = str(HERE / "contenders" / f"with_{self.name}.py")
            own = self.name in ("sigmapoint", "eigen", "numpy")
            command = [sys.executable, file] if own else ["uv", "run", "--quiet", "--script", file]
            pipe = subprocess.PIPE
            self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)
            self._read()
        assert self._process.stdin
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        return json.loads(self._read())

    def _read(self) -> str:
        assert self._process
        assert self._process.stdout
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit(f"{self.name} ended without an answer (status {self._process.wait()})")
        return line

    def close(self) -> None:
        """End the process."""
        if self._process and self._process.stdin:
            self._process.stdin.close()
            self._process.wait()


def measured(case: Case, contenders: dict[str, Contender], folder: Path, repetitions: int) -> list[dict[str, Any]]:
    """One row for each contender and method: times of a step in microseconds, and how far its means are from ours."""
    each = [measurements(case.problem, case.rows, seed) for seed in range(min(case.series, 100))]
    y = np.stack([each[i % len(each)] for i in range(case.series)]) if case.task == "batch" else each[0]
    data = folder / "y.npy"
    np.save(data, y)
    found: dict[tuple[str, str], dict[str, Any]] = {}
    means: dict[tuple[str, str], np.ndarray] = {}
    for _ in range(repetitions):
        for name, methods in case.entrants.items():
            for method in methods if name in contenders else []:
                row = found.setdefault((name, method), {"us_per_step": [], "median_us": [], "p99_us": []})
                if "error" in row:
                    continue
                request = {"task": case.task, "method": method, "problem": case.problem, "data": str(data)}
                answer = contenders[name].ask(**request, key=f"{case.part} {case.rows} {case.series}")
                if "error" in answer:
                    row["error"] = answer["error"]
                    continue
                if "means" in answer:
                    row["first_s"] = answer["first_s"]
                    means[name, method] = np.load(answer["means"])
                    os.unlink(answer["means"])
                row["us_per_step"].append(answer["seconds"] / case.rows / case.series * 1e6)
                for quantile in ("median_us", "p99_us"):
                    row[quantile] += [answer[quantile]] if quantile in answer else []
    for (name, method), at in means.items():
        reference = means.get(("sigmapoint", _family(method)))
        if reference is not None:
            others = tuple(range(reference.ndim - 1))
            std = reference.std(axis=others)
            scale = np.where(std > 0, std, np.abs(reference).max(axis=others))
            found[name, method]["difference"] = float(np.max(np.abs(at - reference) / scale))
    kept = {"part": case.part, "task": case.task, "problem": case.problem, "rows": case.rows, "series": case.series}
    return [
        {**kept, "contender": name, "method": method, **{key: value for key, value in row.items() if value != []}}
        for (name, method), row in found.items()
    ]


def table(rows: list[dict[str, Any]]) -> str:
    """What was measured, as Markdown: medians, and each time as a multiple of our own of the same kind."""
    lines = ["| problem | rows | library | method | µs a step | × ours | difference | first, s |"]
    lines.append("|---|---|---|---|---|---|---|---|")
    for row in rows:
        size = f"{row['rows']:,}" if row["series"] == 1 else f"{row['series']:,} × {row['rows']}"
        task = "" if row["task"] == "filter" else f", {row['task']}"
        library = NAMES.get(row["contender"], row["contender"])
        head = f"| {row['problem']}{task} | {size} | {library} | {row['method']} |"
        if "error" in row:
            lines.append(f"{head} {row['error'][:60]} | | | |")
            continue
        ours = [r for r in rows if r["contender"] == "sigmapoint" and all(r[k] == row[k] for k in ALIKE)]
        ours = [r for r in ours if "error" not in r and not (_drawn(row["method"]) and r["method"] != row["method"])]
        same = [r for r in ours if r["method"] == _family(row["method"])] or ours
        ratio = f"{time(row) / time(same[0]):.2f}" if same else ""
        difference = _compared(row) if "difference" in row else ""
        lines.append(f"{head} {time(row):.3g} | {ratio} | {difference} | {row['first_s']:.1f} |")
    return "\n".join(lines) + "\n"


ABOVE = """# All benchmark numbers

Medians of the repetitions. *× ours*: beside our `ukf`, or our `srekf` for extended filters, in the same run.
*Difference*: the largest difference of a mean from that of ours, over the standard deviation of these means in time, or
over their size where they do not move (a central difference filter is another filter, and differs; those of particles
differ by their draws). *First*: seconds of the first call, with compilation.

"""
ALIKE = ("part", "task", "problem", "rows", "series")


def _compared(row: dict[str, Any]) -> str:
    difference = row["difference"]
    same = difference <= SAME or _drawn(row["method"])
    return f"{difference:.0e}" if same else f"**another filter: {difference:.0e}**"


def _drawn(method: str) -> bool:
    """Means are of draws, and differ."""
    return method.startswith(("bootstrap", "upf"))


def _family(method: str) -> str:
    if _drawn(method):
        return method
    return "srekf" if method.endswith("ekf") else "ukf"


def time(row: dict[str, Any]) -> float:
    """Median microseconds of a step; online, the median of a row."""
    return float(np.median(row.get("median_us") or row["us_per_step"]))


def about() -> dict[str, Any]:
    """Where and when."""
    return {
        "date": date.today().isoformat(),
        "cores": os.cpu_count(),
        "machine": platform.machine(),
        "python": platform.python_version(),
    }


def main() -> None:
    """Measure, and write after every case, so that what is there survives an interruption."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="turn,states,length,batch,online,particles", help="parts, with commas")
    parser.add_argument("--contenders", default="", help="which, with commas; default: all")
    parser.add_argument("--repetitions", type=int, default=7)
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--figures", action="store_true", help="only draw and write the table again")
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    results = chosen.out / "results.json"
    if chosen.figures:
        rows = json.loads(results.read_text())["rows"]
    else:
        names = sorted(p.stem.removeprefix("with_") for p in (HERE / "contenders").glob("with_*.py"))
        contenders = {
            name: Contender(name) for name in names if name in (chosen.contenders or ",".join(names)).split(",")
        }
        before = json.loads(results.read_text())["rows"] if results.exists() else []
        rows = [row for row in before if row["part"] not in chosen.only.split(",")]  # measured before: they stay
        with tempfile.TemporaryDirectory() as folder:
            for case in cases():
                if case.part in chosen.only.split(",") and set(case.entrants) & set(contenders):
                    rows += measured(case, contenders, Path(folder), chosen.repetitions)
                    results.write_text(json.dumps({"about": about(), "rows": rows}, indent=1))
                    print(table(rows[-sum(map(len, case.entrants.values())) :]), flush=True)
        for contender in contenders.values():
            contender.close()
    (chosen.out / "table.md").write_text(ABOVE + table(rows))
    if importlib.util.find_spec("matplotlib"):
        drawn(rows, chosen.out)


if __name__ == "__main__":
    main()
