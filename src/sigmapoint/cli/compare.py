"""`sigmapoint compare MODEL.py DATA`: several methods on the same data, side by side."""

import time
from pathlib import Path
from typing import Any

from rich.console import Console

from sigmapoint.cli import modelfile, output
from sigmapoint.cli.data import Clock
from sigmapoint.cli.errors import InputError, blaming, folder, guarded
from sigmapoint.cli.expressions import parse_methods
from sigmapoint.cli.run import ALL_METHODS, Data, Debug, Float32, Methods, Model, Out, Seed, Smooth, frame_of
from sigmapoint.comparison import Comparison, Row
from sigmapoint.comparison import compare as compared

HEADINGS = {
    "coverage_2sigma": "in ±2σ (0.954)",
    "nis_per_element": "NIS per element (1)",
    "log_likelihood": "log likelihood",
    "us_per_step": "µs/step",
    "compile_s": "compile s",
}


@guarded
def compare(
    model: Model,
    data: Data,
    methods: Methods = ALL_METHODS,
    smooth: Smooth = False,
    seed: Seed = 0,
    out: Out = Path("sigmapoint-compare"),
    float32: Float32 = False,
    debug: Debug = False,
) -> None:
    """Run several methods on the model in MODEL.py and the measurements in DATA, and put them side by side.

    Writes estimates.parquet (all methods), summary.json and report.html into the folder of --out. Errors and coverage
    are there where MODEL.py names a `truth`. MODEL.py and DATA are as for `sigmapoint run`.
    """
    chosen, folder_out = parse_methods(methods), folder(out)
    problem = modelfile.load(model, data)
    begin = time.perf_counter()
    with output.progress(len(chosen)) as each, blaming(model):
        of_all = problem.model, problem.y, problem.u, chosen, problem.truth
        result = compared(*of_all, key=seed, smooth=smooth, each=each)
    result = result._replace(posteriors={name: problem.labelled(post) for name, post in result.posteriors.items()})
    if not result.posteriors:
        raise InputError(f"no method could run; {result.rows[0]['method']}: {result.rows[0]['note']}")
    summary = {
        "T": len(problem.y),
        "smoothed": smooth,
        "seed": seed,
        "rows": result.rows,
        "nis": {name: output.innovations(post) for name, post in result.posteriors.items()},
        "seconds": time.perf_counter() - begin,
        "versions": output.versions(),
    }
    rows = [headed(row) for row in result.rows]
    title = f"{model.stem}: {len(result.rows)} methods on {data.name}"
    page: dict[str, Any] = {
        "time": problem.clock.shown,
        "time_label": problem.clock.label,
        "truth": problem.truth,
        "title": title,
        "tables": [("methods", rows)],
    }
    files = {
        "estimates.parquet": output.parquet_file(all_frames(result, problem.clock)),
        "summary.json": output.json_file(summary),
        "report.html": output.page_file(result.posteriors, **page),
    }
    paths = output.write_all(folder_out, files)
    console = Console()
    output.noted(console, title, rows)
    output.written(console, paths)


def headed(row: Row) -> Row:
    """A row under the headings that people read; what is expected of a consistent filter is in brackets."""
    return {HEADINGS.get(name, name): value for name, value in row.items()}


def all_frames(result: Comparison, clock: Clock) -> Any:
    """The beliefs of every method under one another, with the method as the first column."""
    import pandas as pd

    frames = {name: frame_of(post, clock) for name, post in result.posteriors.items()}
    for name, frame in frames.items():
        frame.insert(0, "method", name)
    return pd.concat(frames.values(), ignore_index=True)
