"""The report: one page that opens offline, with everything needed to judge a result.

The page holds its own copy of plotly.js, its data and its style; its content security policy forbids the browser to
fetch anything else.
"""

import os
import platform
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import jax
import numpy as np
from plotly.offline import get_plotlyjs

from sigmapoint.comparison import Comparison
from sigmapoint.printing import counted
from sigmapoint.reporting.decimate import POINTS
from sigmapoint.reporting.html import Graphs, number, section, table
from sigmapoint.reporting.runs import Runs, runs_of
from sigmapoint.reporting.sections import accuracy, innovations, nis, states, summary, trust, whiteness
from sigmapoint.results import Posterior, check_single
from sigmapoint.storage import write_atomically
from sigmapoint.tables import instants

POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; font-src data:"
)


def report(
    result: Posterior | Mapping[str, Posterior] | Comparison,
    path: str | os.PathLike[str],
    *,
    time: Any = None,
    time_label: str = "time",
    truth: Any = None,
    title: str | None = None,
    tables: Sequence[tuple[str, Sequence[Mapping[str, Any]]]] | None = None,
    notes: str | Sequence[str] | None = None,
) -> Path:
    """Write an interactive page about a result, for a browser, readable without a network.

    Args:
        result: what `filter`, `smooth` or `compare` gave, or several results by name (methods over the same data).
        path: the file to write, `report.html`; replaced as a whole if it is there.
        time: instants (T,), numbers or dates; 0, 1, 2, … where not given.
        time_label: what the horizontal axis says, with its unit: `time [s]`.
        truth: true states (T, n) where known, NaN where not.
        title: headline.
        tables: further tables, each a caption and rows (dictionaries of column to value).
        notes: a paragraph or several, put at the end.

    Returns:
        The path of the page.

    Raises:
        ValueError: a batch of results; results of different series; `time` or `truth` of another shape.
        OSError: the file cannot be written; what was there stays as it was.

    Examples:
        >>> import tempfile, pathlib, jax.numpy as jnp, sigmapoint as sp
        >>> from sigmapoint.reporting import report
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     report(sp.filter(model, jnp.ones((50, 1))), pathlib.Path(folder) / "report.html").name
        'report.html'
    """
    if isinstance(result, Comparison):
        result = result.posteriors
    first = next(iter(result.values()), None) if isinstance(result, Mapping) else result
    if not isinstance(first, Posterior):
        raise ValueError(
            "result must come from sp.filter, sp.smooth or sp.compare, or be a dict of name to such results, got "
            f"{type(first).__name__}"
        )
    check_single(first)
    x = instants(time, first.y.shape[0])
    runs = runs_of(result, x, "sample" if time is None else time_label, truth)
    page = _page(title or "Estimation report", runs, tables or (), [notes] if isinstance(notes, str) else notes or ())
    path = Path(path)
    write_atomically(path, lambda file: file.write(page.encode()))
    return path


def _page(title: str, runs: Runs, tables: Sequence[Any], notes: Sequence[str]) -> str:
    graphs = Graphs()
    sections = {
        "Summary": summary(runs),
        "Trust": trust(runs),
        "States": states(runs, graphs),
        "Accuracy": accuracy(runs, graphs),
        "Measurements": innovations(runs, graphs),
        "NIS": nis(runs, graphs),
        "Whiteness": whiteness(runs, graphs),
        "Tables": section("tables", "Tables", "", *(table(caption, rows) for caption, rows in tables)),
        "Notes": section("notes", "Notes", "", *(f"<p>{escape(str(note))}</p>" for note in notes)),
        "Run": section("run", "What was run", _drawing(runs), table("", _versions(runs))),
    }
    links = "".join(f'<a href="#{name.lower()}">{name}</a>' for name, html in sections.items() if html)
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{POLICY}">
<title>{escape(title)}</title>
<link rel="icon" href="data:,">
<style>{_part("page.css")}</style>
</head>
<body>
<header><div class="inner"><h1>{escape(title)}</h1><div class="soft">{escape(_subtitle(runs))}</div></div></header>
<nav aria-label="Sections"><div class="inner">{links}</div></nav>
<main>
{"".join(sections.values())}
<footer class="soft">Made by sigmapoint. This page needs no network: it holds its data and its drawing code.</footer>
</main>
<script>{get_plotlyjs()}</script>
<script>{_part("page.js")}</script>
</body>
</html>
"""


def _part(name: str) -> str:
    return files("sigmapoint.reporting").joinpath(name).read_text(encoding="utf-8")


def _subtitle(runs: Runs) -> str:
    T, m = len(runs.x), len(runs.labels.observations)
    n = len(runs.labels.states)
    methods = ", ".join(run.name for run in runs.each if run.name)
    counts = (
        f"{counted(T, 'sample')} · {counted(n, 'state')} · {counted(m, 'measured quantity', 'measured quantities')}"
    )
    return f"{methods} · {counts}" if methods else counts


def _drawing(runs: Runs) -> str:
    if len(runs.x) <= POINTS:
        return "Every sample is drawn."
    return (
        f"Curves are drawn with at most {POINTS} points each, the smallest and largest of every stretch, so that "
        "no peak is lost; every number on this page is computed from all samples."
    )


def _versions(runs: Runs) -> list[dict[str, Any]]:
    import sigmapoint

    dtype = next((str(run.mean.dtype) for run in runs.each if run.mean is not None), str(runs.y.dtype))
    used = {
        "method": ", ".join(run.name for run in runs.each) or None,
        "samples": number(len(runs.x)),
        "precision": dtype,
        "sigmapoint": sigmapoint.__version__,
        "jax": jax.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
    }
    return [{"what": name, "value": str(value)} for name, value in used.items() if value is not None]
