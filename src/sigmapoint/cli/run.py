"""`sigmapoint run MODEL.py DATA`: estimate the states of a model from logged data."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console

import sigmapoint as sp
from sigmapoint.cli import modelfile, output
from sigmapoint.cli.data import Clock
from sigmapoint.cli.errors import blaming, folder, guarded
from sigmapoint.cli.expressions import parse_method
from sigmapoint.comparison import STANDARD
from sigmapoint.results import Posterior, field
from sigmapoint.timing import clocked

Model = Annotated[Path, typer.Argument(metavar="MODEL.py", help="Has `model` or `build(u, time)`, and `measurements`.")]
Data = Annotated[Path, typer.Argument(metavar="DATA", help="Logged data: .csv, .csv.gz or .parquet, one row a sample.")]
Out = Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the results; made if it is not there.")]
Float32 = Annotated[bool, typer.Option("--float32", help="Compute in 32-bit numbers in place of 64-bit.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]
ALL_METHODS = ",".join(STANDARD)
Methods = Annotated[str, typer.Option(help="Methods with commas between, like ekf,srukf,'ukf(alpha=1e-3)'.")]
Seed = Annotated[int, typer.Option(help="Of the random numbers, for methods that draw.")]
Smooth = Annotated[bool, typer.Option("--smooth", help="Each state from all measurements, past and future.")]


@guarded
def run(
    model: Model,
    data: Data,
    method: Annotated[
        str, typer.Option(help="A method, like srukf, 'ukf(alpha=1e-3)', 'iterated(srukf(), 3)', 'bootstrap(1000)'.")
    ] = "srcdkf",
    smooth: Smooth = False,
    seed: Seed = 0,
    out: Out = Path("sigmapoint-run"),
    float32: Float32 = False,
    debug: Debug = False,
) -> None:
    """Estimate the states of the model in MODEL.py from the measurements in DATA.

    Writes estimates.parquet, summary.json and report.html into the folder of --out.

    MODEL.py has `model = sp.StateSpaceModel(...)` or `build(u, time)` that returns one, `measurements` (columns, or a
    dict observation -> column), and where needed `inputs` (dict key of u -> column), `time` (column), `interval` (key
    of u for the time to the next row) and `truth` (dict state -> column). Columns may carry units: `voltage [V]` or
    `Voltage(V)`. Empty cells were not measured.

    Where the filter breaks down (estimates or likelihood not finite, or no particle explains a measurement), the files
    are written all the same, and the exit code is 1.
    """
    chosen, folder_out = parse_method(method), folder(out)
    problem = modelfile.load(model, data)
    estimate = sp.smooth if smooth else sp.filter
    with Console(stderr=True).status("compiling and running"), blaming(model):
        post, seconds = clocked(lambda: estimate(problem.model, problem.y, problem.u, chosen, key=seed))
    post = problem.labelled(post)
    rows = final_rows(post)
    files = {
        "estimates.parquet": output.parquet_file(frame_of(post, problem.clock)),
        "summary.json": output.json_file(summary(post, method, smooth, seconds) | {"seed": seed, "final": rows}),
        "report.html": output.page_file(
            post,
            time=problem.clock.shown,
            time_label=problem.clock.label,
            truth=problem.truth,
            title=f"{model.stem}: {method}{', smoothed' if smooth else ''}, {data.name}",
        ),
    }
    paths = output.write_all(folder_out, files)
    console = Console()
    console.print(output.table("last row", rows))
    console.print(output.table("run", [overview(post, method, seconds)]))
    output.written(console, paths)
    if post.breakdown() is not None:
        raise typer.Exit(1)


def frame_of(post: Posterior, clock: Clock) -> Any:
    """All beliefs as a data frame with time as its first column; units are in its `attrs`, and go into the file."""
    from sigmapoint.tables import to_frame

    frame = to_frame(post, clock.shown).reset_index()
    frame.attrs["units"] = {"time": clock.unit, **frame.attrs["units"]}
    return frame


def final_rows(post: Posterior) -> list[dict[str, Any]]:
    """The last belief, one row a state."""
    mean, std = field(post, "mean"), field(post, "std")
    stds = std[-1] if std.shape == mean.shape else np.full(mean.shape[1], np.nan)
    return [
        {"state": name, "estimate": float(m), "std": float(s), "unit": unit}
        for name, m, s, unit in zip(post.labels.states, mean[-1], stds, post.labels.state_units)
    ]


def overview(post: Posterior, method: str, seconds: float) -> dict[str, Any]:
    """One row about a whole run."""
    nis = output.innovations(post)
    return {
        "method": method,
        "samples": post.y.shape[0],
        "measured": int(np.isfinite(post.y).sum()),
        "log likelihood": float(post.log_likelihood),
        "NIS per element (1)": nis["per_element"],
        "seconds with compiling": seconds,
    }


def summary(post: Posterior, method: str, smooth: bool, seconds: float) -> dict[str, Any]:
    """What `summary.json` says about a run; states and measurements with their units."""
    return {
        "method": method,
        "smoothed": smooth,
        "T": post.y.shape[0],
        "dtype": str(post.y.dtype),
        "states": dict(zip(post.labels.states, post.labels.state_units)),
        "measurements": dict(zip(post.labels.observations, post.labels.observation_units)),
        "log_likelihood": float(post.log_likelihood),
        "nis": output.innovations(post),
        "seconds": seconds,
        "versions": output.versions(),
    }
