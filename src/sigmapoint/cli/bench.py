"""`sigmapoint bench MODEL.py DATA`: how long each method takes on a model of one's own."""

import dataclasses
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import jax
import numpy as np
import typer
from rich.console import Console

import sigmapoint as sp
from sigmapoint.cli import modelfile, output
from sigmapoint.cli.doctor import examined
from sigmapoint.cli.errors import InputError, blaming, folder, guarded
from sigmapoint.cli.expressions import parse_methods
from sigmapoint.cli.run import Data, Debug, Float32, Model, Out
from sigmapoint.comparison import STANDARD
from sigmapoint.methods import Method

KEEP = ("mean", "std")
LIVE = 1000
"""Rows fed to the live filter, at most."""


@guarded
def bench(
    model: Model,
    data: Data,
    methods: Annotated[
        str, typer.Option(help="Methods with commas between, like ekf,srukf,'ukf(alpha=1e-3)'.")
    ] = ",".join(STANDARD),
    repetitions: Annotated[int, typer.Option(min=1, help="Runs of each method; the median counts.")] = 7,
    out: Out = Path("sigmapoint-bench"),
    float32: Float32 = False,
    debug: Debug = False,
) -> None:
    """Time several methods on the model in MODEL.py and the measurements in DATA.

    Filter, smoother and gradient of the likelihood (in the initial mean) over the whole series, in microseconds a row:
    medians of runs of all methods in turn, after one that compiles. Then the live filter, row by row. Writes bench.json
    into the folder of --out. MODEL.py and DATA are as for `sigmapoint run`.
    """
    jax.config.update("jax_enable_compilation_cache", False)  # the first call is to be one
    chosen, folder_out = parse_methods(methods), folder(out)
    problem = modelfile.load(model, data)
    rows: dict[str, dict[str, Any]] = {name: {"method": name} for name in chosen}
    runs: dict[str, dict[str, Callable[[], Any]]] = {}
    with output.progress(len(chosen) + repetitions) as each, blaming(model):
        for name, method in chosen.items():
            each(f"{name}, compiling")
            try:
                runs[name] = _runs(problem, method)
                rows[name]["first call s"] = _seconds(runs[name]["filter"])
                rows[name] |= _live(problem, method)
                for run in runs[name].values():
                    run()
            except ValueError as error:
                runs.pop(name, None)
                rows[name] = {"method": name, "note": str(error)}
        if not runs:
            raise InputError(f"no method could run; {next(iter(chosen))}: {rows[next(iter(chosen))]['note']}")
        times: dict[tuple[str, str], list[float]] = {(name, kind): [] for name in runs for kind in runs[name]}
        for k in range(repetitions):
            each(f"run {k + 1} of {repetitions}")
            for name, kind in times:
                times[name, kind].append(_seconds(runs[name][kind]) / len(problem.y) * 1e6)
    for (name, kind), found in times.items():
        rows[name] |= {f"{kind} µs/row": float(np.median(found))}
    title = f"{model.stem}: {len(problem.y)} rows, {problem.model.initial.mean.shape[0]} states"
    details = {f"{name} {kind}": found for (name, kind), found in times.items()}
    content = {"rows": list(rows.values()), "us_per_row": details, "system": examined(), "load": os.getloadavg()}
    paths = output.write_all(folder_out, {"bench.json": output.json_file(content)})
    console = Console()
    console.print(output.table(title, [{k: v for k, v in row.items() if k != "note"} for row in rows.values()]))
    for row in rows.values():
        if "note" in row:
            console.print(f"{row['method']}: {row['note']}", markup=False, highlight=False)
    output.written(console, paths)


def _seconds(run: Callable[[], Any]) -> float:
    begin = time.perf_counter()
    run()
    return time.perf_counter() - begin


def _runs(problem: modelfile.Problem, method: Method) -> dict[str, Callable[[], Any]]:
    """What is timed over the whole series, by name."""
    model, y, u = problem.model, problem.y, problem.u
    initial = model.initial

    def likelihood(mean: Any) -> Any:
        moved = dataclasses.replace(model, initial=sp.Gaussian(mean, initial.cov))
        return sp.filter(moved, y, u, method, keep=()).log_likelihood

    gradient = jax.jit(jax.grad(likelihood))
    return {
        "filter": lambda: jax.block_until_ready(sp.filter(model, y, u, method, keep=KEEP)),
        "smoother": lambda: jax.block_until_ready(sp.smooth(model, y, u, method, keep=KEEP)),
        "gradient": lambda: jax.block_until_ready(gradient(initial.mean)),
    }


def _live(problem: modelfile.Problem, method: Method) -> dict[str, float]:
    """Median and 99th percentile of a step of the live filter, in microseconds."""
    y, u = np.asarray(problem.y), jax.tree.map(np.asarray, problem.u)
    inputs = [jax.tree.map(lambda a, k=k: a[k], u) for k in range(min(LIVE, len(y)))]
    live = sp.online(problem.model, method)
    ahead, taken = live.prepare(y[0], inputs[0]), []
    for row, given in zip(y, inputs):
        begin = time.perf_counter()
        ahead = live.step(ahead, row, given)[2]
        taken.append(time.perf_counter() - begin)
    middle, late = (float(q) * 1e6 for q in np.quantile(taken, [0.5, 0.99]))
    return {"live µs": middle, "live p99 µs": late}
