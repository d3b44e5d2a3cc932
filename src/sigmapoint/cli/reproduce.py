"""`sigmapoint reproduce NAME`: an experiment of the papers, run again here."""

import difflib
import os
from collections.abc import Mapping, Sequence
from contextlib import closing
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from sigmapoint.cli import output
from sigmapoint.cli.cache import kept_between_runs
from sigmapoint.cli.errors import InputError, folder, guarded, named, stopped
from sigmapoint.cli.run import Debug

if TYPE_CHECKING:
    from sigmapoint.experiments.publishing.side_by_side import Task

MOST_JOBS = 4
"""few, as each takes a gigabyte or two of memory"""


@guarded
def reproduce(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="Which experiment; --list shows them.")] = None,
    show: Annotated[bool, typer.Option("--list", help="Show the experiments and stop.")] = False,
    every: Annotated[bool, typer.Option("--all", help="Run every experiment.")] = False,
    quick: Annotated[bool, typer.Option("--quick", help="A small version: seconds in place of minutes.")] = False,
    runs: Annotated[int | None, typer.Option(min=2, help="Monte-Carlo runs; default: the experiment's own.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random numbers.")] = 0,
    data: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of real data, for those that simulate them otherwise; see --list."),
    ] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Each experiment writes into DIR/NAME.")] = Path("out"),
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Leave those that DIR has from a whole run by the same options and packages."),
    ] = False,
    jobs: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="With --all, experiments at a time, each in a process; those that take times run alone. Default: one "
            f"a core, at most {MOST_JOBS}.",
        ),
    ] = None,
    debug: Debug = False,
) -> None:
    """Run an experiment of the papers and put its numbers beside the published ones.

    Each writes results.json, claim.json, run.json, figures and report.html into DIR/NAME; --all also index.html, with
    every claim and what became of it, and the published numbers beside the measured ones as results.md and .tex.
    One that fails is named there, and the others run on.
    """
    from sigmapoint.experiments import EXPERIMENTS
    from sigmapoint.experiments.publishing.campaign import Settings, finished, index
    from sigmapoint.experiments.publishing.side_by_side import Task, side_by_side

    console = Console()
    if show:
        known = [
            {"name": e.name, "what": f"{e.description}; --data: {e.data}" if e.data else e.description}
            for e in EXPERIMENTS.values()
        ]
        console.print(output.table("experiments", known))
        return
    if every and name is not None:
        raise InputError(f"give {name} or --all, not both")
    if jobs is not None and not every:
        raise InputError("--jobs goes with --all: a single experiment is one process")
    folder(out)
    chosen = list(EXPERIMENTS) if every else [_known(name, list(EXPERIMENTS))]
    takers = _takers(data, chosen, {e.name: e.data for e in EXPERIMENTS.values()})
    folders = {experiment: folder(out / experiment) for experiment in chosen}
    whole = None if data is None else str(data.resolve())
    tasks = [Task(e, Settings(runs, seed, quick, whole if e in takers else None), folders[e]) for e in chosen]
    done = {task.name for task in tasks if resume and finished(task.settings, task.out)}
    for experiment in sorted(done):
        console.print(f"kept {folders[experiment]}", markup=False)
    left, failed = [task for task in tasks if task.name not in done], {}
    several = (jobs or min(os.cpu_count() or 1, MOST_JOBS)) if every else 1
    try:
        with (
            Console(stderr=True).status(f"running {', '.join(task.name for task in left)}"),
            closing(side_by_side(left, several, kept_between_runs)) as outcomes,
        ):
            for task, outcome in outcomes:
                stopped()
                try:
                    _tell(console, task, outcome())
                    done.add(task.name)
                except Exception as error:
                    if debug or not every:
                        raise
                    failed[task.name] = named(error)  # the others do not depend on it
                    console.print(f"{task.name} failed: {failed[task.name]}", markup=False)
    finally:  # also of what was done before an interrupt
        if every and (done or failed):
            output.written(console, index(out, [name for name in chosen if name in done], failed))
    if failed:
        raise RuntimeError(f"{', '.join(failed)} failed, see above; --resume runs only what is missing")


def _tell(console: Console, task: "Task", rows: Sequence[Mapping[str, Any]]) -> None:
    console.print(output.table(task.name, _shown(rows)))
    output.written(console, sorted(p for p in task.out.iterdir() if p.is_file()))


def _known(name: str | None, names: list[str]) -> str:
    if name in names:
        return name
    if name is None:
        raise InputError(f"name an experiment, or give --all; experiments: {', '.join(names)}")
    close = difflib.get_close_matches(name, names, n=1)
    hint = f" Did you mean {close[0]}?" if close else ""
    raise InputError(f"unknown experiment {name!r}.{hint} Experiments: {', '.join(names)}")


def _takers(data: Path | None, chosen: Sequence[str], held: Mapping[str, str]) -> list[str]:
    """Those of the `chosen` that take a folder of data, where one is given."""
    if data is None:
        return []
    takers = [name for name in chosen if held[name]]
    if not takers:
        named = ", ".join(name for name, what in held.items() if what) or "none"
        raise InputError(f"--data: {', '.join(chosen)} takes no folder of data; experiments that do: {named}")
    if not data.is_dir():
        raise InputError(f"--data {data} is not a folder; {' and '.join(f'{n} wants {held[n]}' for n in takers)}")
    return takers


def _shown(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Each quantity as a line of its own, with its methods below; notes are on the page."""
    lines: list[dict[str, Any]] = []
    for quantity, group in groupby(rows, key=lambda row: row.get("quantity", "")):
        lines.append({"method": quantity})
        for row in group:
            cells = {"published": row.get("published"), "measured": row.get("measured"), "±": row.get("spread")}
            lines.append({"method": f"  {row.get('method', '')}", **cells, "runs": row.get("runs")})
    return lines
