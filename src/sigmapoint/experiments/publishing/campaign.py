"""Several experiments in turn: what was done before is left, and an index page puts all beside each other.

Beside what an experiment leaves (`results`) there is `run.json`: its settings, its time, and the versions that ran.
Above all folders are `index.html`, `results.json` with every row, and the numbers that the papers print as `results.md`
and `results.tex`.
"""

import json
import os
import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from html import escape
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

from sigmapoint.experiments import Experiment
from sigmapoint.experiments.publishing.page import framed, number
from sigmapoint.experiments.publishing.results import WORDS
from sigmapoint.storage import write_atomically
from sigmapoint.timing import clocked

PACKAGES = ("sigmapoint", "jax", "jaxlib", "equinox", "numpy", "scipy", "jsbsim")
FILES = ("claim.json", "results.json", "report.html", "run.json")
"""Of an experiment that came to its end."""


class Settings(NamedTuple):
    """What an experiment is run with."""

    runs: int | None
    """None: the experiment's own number"""
    seed: int
    quick: bool
    data: str | None
    """folder of real data"""


def conducted(experiment: Experiment, settings: Settings, out: Path) -> list[dict[str, Any]]:
    """Run an experiment in its folder, and note how; its rows."""
    folder = () if settings.data is None else (Path(settings.data),)
    (out / "run.json").unlink(missing_ok=True)
    where = {"versions": versions(), "cores": os.cpu_count()}
    rows, seconds = clocked(lambda: experiment.run(settings.runs, settings.seed, out, settings.quick, *folder))
    done = {**settings._asdict(), "seconds": seconds, **where}
    _write(out / "run.json", json.dumps(done, indent=1))
    return rows


def versions() -> dict[str, str]:
    """Of what computes, as far as it is installed."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def finished(settings: Settings, out: Path) -> bool:
    """Whether an experiment was run to its end with these settings, by what is installed now."""
    if not all((out / name).is_file() for name in FILES):
        return False
    done = _read(out / "run.json")
    wanted = {**settings._asdict(), "versions": versions()}
    return {name: done.get(name) for name in wanted} == wanted


class Done(NamedTuple):
    """What is in the folder of one experiment."""

    name: str
    claim: Mapping[str, Any]
    run: Mapping[str, Any]
    rows: Sequence[Mapping[str, Any]]

    @classmethod
    def of(cls, name: str, out: Path) -> "Done":
        return cls(name, *(_read(out / name / f"{part}.json") for part in ("claim", "run", "results")))

    @property
    def printed(self) -> list[Mapping[str, Any]]:
        """Rows of which the papers print a number."""
        return [row for row in self.rows if row["published"] is not None]


def index(out: Path, names: Sequence[str], failed: Mapping[str, str]) -> list[Path]:
    """Write the index of the experiments in these folders of `out`; of those that `failed`, why. The files written."""
    out.mkdir(parents=True, exist_ok=True)
    every = [Done.of(name, out) for name in names]
    rows = [row for done in every for row in done.rows]
    files = {
        "index.html": framed("The papers' experiments", _index(every, failed)),
        "results.json": json.dumps(rows, indent=1, ensure_ascii=False),
        "results.md": _markdown(every),
        "results.tex": _latex(every),
    }
    return [_write(out / name, text) for name, text in files.items()]


def _index(every: Sequence[Done], failed: Mapping[str, str]) -> str:
    held = [done for done in every if done.claim["holds"]]
    lines = "".join(
        f'<tr><td><a href="#{done.name}">{done.name}</a></td><td>{escape(done.claim["claim"])}</td>'
        f"<td>{WORDS[done.claim['holds']]}</td><td class=n>{done.run['seconds']:.0f}</td></tr>"
        for done in every
    )
    lines += "".join(
        f"<tr><td>{name}</td><td>failed: {escape(why)}</td><td></td><td></td></tr>" for name, why in failed.items()
    )
    minutes = sum(done.run["seconds"] for done in every) / 60
    return (
        f"<p>{len(held)} of {len(every) + len(failed)} claims reproduced, in {minutes:.0f} minutes together.</p>"
        f'<div class="wide"><table>{SUMMARY}{lines}</table></div>' + "".join(_section(done) for done in every)
    )


def _section(done: Done) -> str:
    shown = done.rows if len(done.printed) == 0 else done.printed
    lines = "".join(
        f"<tr><td>{escape(row['quantity'])}</td><td>{escape(row['method'])}</td><td class=n>{number(row['published'])}"
        f"</td><td class=n>{number(row['measured'])}</td><td class=n>{number(row['spread'])}</td></tr>"
        for row in shown[:MOST]
    )
    more = f"<p><small>{len(shown) - MOST} more on its page.</small></p>" if len(shown) > MOST else ""
    run, claim = done.run, done.claim
    first = "".join(
        f'<figure><img alt="{escape(claim["title"])}" loading="lazy" src="{done.name}/{file}"></figure>'
        for file in claim["pictures"][:1]
    )
    how = f"{run['seconds']:.0f} s, seed {run['seed']}{', quick' if run['quick'] else ''}, {run['cores']} cores"
    versions = ", ".join(f"{name} {one}" for name, one in run["versions"].items())
    return (
        f'<h2 id="{done.name}"><a href="{done.name}/report.html">{done.name}</a></h2><p>{escape(claim["title"])}.</p>'
        f"<p>Claim: {escape(claim['claim'])}</p>"
        f"<p><strong>{escape(claim['verdict'])}</strong>.</p>"
        f'{first}<div class="wide"><table>{HEAD}{lines}</table></div>{more}'
        f"<p><small>{escape(how)}; {escape(versions)}</small></p>"
    )


def _markdown(every: Sequence[Done]) -> str:
    lines = ["| experiment | quantity | method | published | measured | ± | runs |", "|---|---|---|---|---|---|---|"]
    lines += [
        f"| {done.name} | {row['quantity']} | {row['method']} | {number(row['published'])} | "
        f"{number(row['measured'])} | {number(row['spread'])} | {row['runs']} |"
        for done in every
        for row in done.printed
    ]
    return "\n".join(lines) + "\n"


def _latex(every: Sequence[Done]) -> str:
    lines = [
        " & ".join(map(_tex, (done.name, row["quantity"], row["method"])))
        + "".join(f" & {_digits(row[column])}" for column in ("published", "measured", "spread"))
        + f" & {row['runs']} \\\\"
        for done in every
        for row in done.printed
    ]
    head = r"experiment & quantity & method & published & measured & $\pm$ & runs \\"
    return "\n".join([ENGINE, r"\begin{tabular}{lllrrrr}", head, r"\hline", *lines, r"\end{tabular}"]) + "\n"


def _tex(text: str) -> str:
    return "".join(SPELT.get(c, c) for c in text)


def _digits(value: float | None) -> str:
    """A number in a column of LaTeX."""
    shown = number(value).replace("−", "-")
    mantissa, is_small, power = shown.partition("e")
    shown = f"{mantissa}\\cdot 10^{{{int(power)}}}" if is_small else shown
    return "--" if shown == "–" else f"${shown}$"


def _read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def _write(path: Path, text: str) -> Path:
    write_atomically(path, lambda file: file.write(text.encode()))
    return path


ENGINE = "% Greek letters stand as they are: for LuaLaTeX or XeLaTeX."
SPELT = {c: f"\\{c}" for c in "&%$#_{}"} | {
    "\\": r"\textbackslash{}", "^": r"\textasciicircum{}", "~": r"\textasciitilde{}",
}  # fmt: skip
"""what LaTeX would take for something else"""
SUMMARY = "<thead><tr><td>experiment</td><td>claim</td><td></td><td class=n>seconds</td></tr></thead>"
MOST = 12
"""rows of one experiment on the index"""
HEAD = (
    "<thead><tr><td>quantity</td><td>method</td><td class=n>published</td><td class=n>measured</td><td class=n>±</td>"
    "</tr></thead>"
)
