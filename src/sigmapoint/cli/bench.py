"""`sigmapoint bench MODEL.py DATA`: how long each method takes on a model of one's own."""

import dataclasses
import time
from collections.abc import Callable, Mapping
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
from sigmapoint.cli.run import ALL_METHODS, Data, Debug, Float32, Methods, Model, Out
from sigmapoint.recipe import Recipe
from sigmapoint.timing import clocked

KEEP = ("mean", "std")
SEED = 0
"""For methods that draw."""
LIVE = 1000
"""Rows fed to the live filter, at most."""

Runs = dict[str, Callable[[], Any]]


@guarded
def bench(
    model: Model,
    data: Data,
    methods: Methods = ALL_METHODS,
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
    rows: list[dict[str, Any]] = []
    runs: dict[str, Runs] = {}
    with output.progress(len(chosen) + repetitions) as each, blaming(model):
        for name, method in chosen.items():
            each(f"{name}, compiling")
            row, runs[name] = _first(problem, name, method)
            rows.append(row)
        if not any(runs.values()):
            raise InputError(f"no method could run; {rows[0]['method']}: {rows[0]['note']}")
        times = _in_turn(problem, runs, repetitions, each)
    for row in rows:
        own = times[row["method"]]
        row |= {f"{kind} µs/row": float(np.median(found)) for kind, found in own.items()}
    title = f"{model.stem}: {len(problem.y)} rows, {problem.model.initial.mean.shape[0]} states"
    content = {"rows": rows, "us_per_row": times, "system": examined()}
    paths = output.write_all(folder_out, {"bench.json": output.json_file(content)})
    console = Console()
    output.noted(console, title, rows)
    output.written(console, paths)


def _first(problem: modelfile.Problem, name: str, method: Recipe) -> tuple[dict[str, Any], Runs]:
    """Everything once: what the first call and the live filter took, and what is to be timed of what worked."""
    row: dict[str, Any] = {"method": name, "note": ""}
    runs = _runs(problem, method)
    try:
        row |= {"first call s": clocked(runs["filter"])[1], **_live(problem, method)}
    except ValueError as error:
        return row | {"note": str(error)}, {}
    for kind in ("smoother", "gradient"):
        try:
            runs[kind]()
        except ValueError as error:
            del runs[kind]
            row["note"] = f"no {kind}: {error}"
    return row, runs


def _in_turn(
    problem: modelfile.Problem, runs: Mapping[str, Runs], repetitions: int, each: Callable[[str], None]
) -> dict[str, dict[str, list[float]]]:
    """Microseconds a row of every run of every method."""
    times: dict[str, dict[str, list[float]]] = {name: {kind: [] for kind in own} for name, own in runs.items()}
    for k in range(repetitions):
        each(f"run {k + 1} of {repetitions}")
        for name, own in runs.items():
            for kind, run in own.items():
                times[name][kind].append(clocked(run)[1] / len(problem.y) * 1e6)
    return times


def _runs(problem: modelfile.Problem, method: Recipe) -> Runs:
    """What is timed over the whole series, by name."""
    model, y, u = problem.model, problem.y, problem.u
    initial = model.initial

    def likelihood(mean: Any) -> Any:
        moved = dataclasses.replace(model, initial=sp.Gaussian(mean, initial.cov))
        return sp.filter(moved, y, u, method, key=SEED, keep=()).log_likelihood

    gradient = jax.jit(jax.grad(likelihood))
    return {
        "filter": lambda: jax.block_until_ready(sp.filter(model, y, u, method, key=SEED, keep=KEEP)),
        "smoother": lambda: jax.block_until_ready(sp.smooth(model, y, u, method, key=SEED, keep=KEEP)),
        "gradient": lambda: jax.block_until_ready(gradient(initial.mean)),
    }


def _live(problem: modelfile.Problem, method: Recipe) -> dict[str, float]:
    """Median and 99th percentile of a step of the live filter, in microseconds."""
    y, u = np.asarray(problem.y), jax.tree.map(np.asarray, problem.u)
    inputs = [jax.tree.map(lambda a, k=k: a[k], u) for k in range(min(LIVE, len(y)))]
    live = sp.online(problem.model, method)
    ahead, taken = live.prepare(y[0], inputs[0], key=SEED), []
    for row, given in zip(y, inputs):
        begin = time.perf_counter()
        ahead = live.step(ahead, row, given)[2]
        taken.append(time.perf_counter() - begin)
    middle, late = (float(q) * 1e6 for q in np.quantile(taken, [0.5, 0.99]))
    return {"live µs": middle, "live p99 µs": late}
