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

from sigmapoint.contents import Contents, Shown, joined
from sigmapoint.identification.contents import separate
from sigmapoint.printing import counted
from sigmapoint.reporting.decimate import POINTS
from sigmapoint.reporting.html import Graphs, anchor, number, section, table
from sigmapoint.reporting.panels import named
from sigmapoint.reporting.runs import Runs, runs_of
from sigmapoint.reporting.sections import drawn, judged
from sigmapoint.results import Posterior, check_single
from sigmapoint.storage import write_atomically
from sigmapoint.tables import instants

POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; font-src data:"
)


def report(
    result: Shown | Mapping[str, Shown],
    path: str | os.PathLike[str],
    *,
    time: Any = None,
    time_label: str = "time",
    truth: Any = None,
    theta: Any = None,
    title: str | None = None,
    tables: Sequence[tuple[str, Sequence[Mapping[str, Any]]]] | None = None,
    notes: str | Sequence[str] | None = None,
) -> Path:
    """Write an interactive page about a result, for a browser, readable without a network.

    Args:
        result: what `filter`, `smooth`, `compare`, `fit`, `em` or `Dual.filter` gave, or several results by name: of
            methods over the same data, or what was learned beside the filter with it. Profiles of a `Fit` are results,
            too.
        path: the file to write, `report.html`; replaced as a whole if it is there.
        time: instants (T,), numbers or dates; 0, 1, 2, … where not given.
        time_label: what the horizontal axis says, with its unit: `time [s]`.
        truth: true states (T, n) where known, NaN where not; with `theta`, without the parameters.
        theta: for results of a model of `joint`, as given to that: the parameters are shown in their own units, in
            place of the vector z among the states.
        title: headline.
        tables: further tables, each a caption and rows (dictionaries of column to value).
        notes: a paragraph or several, put at the end.

    Returns:
        The path of the page.

    Raises:
        ValueError: something that is no result; a batch of results; results of different series; `time` or `truth` of
            another shape, or of a result without a series; a `theta` that is not that of the model.
        OSError: the file cannot be written; what was there stays as it was.

    Examples:
        >>> import tempfile, pathlib, jax.numpy as jnp, sigmapoint as sp
        >>> from sigmapoint.reporting import report
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     report(sp.filter(model, jnp.ones((50, 1))), pathlib.Path(folder) / "report.html").name
        'report.html'

        With what was learned beside the filter that uses it:

        >>> found = sp.em(model, jnp.sin(jnp.arange(50.0))[:, None], tolerance=0.1)
        >>> both = {"em": found, "filter": sp.filter(found.model, jnp.ones((50, 1)))}
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     report(both, pathlib.Path(folder) / "em.html").name
        'em.html'
    """
    contents = _contents(result, theta)
    series = _series(contents.posteriors, time, "sample" if time is None else time_label, truth)
    said = [notes] if isinstance(notes, str) else notes or ()
    page = _page(title or "Estimation report", contents, series, tables or (), said)
    path = Path(path)
    write_atomically(path, lambda file: file.write(page.encode()))
    return path


def _contents(result: Any, theta: Any) -> Contents:
    """Of one result, or of several by name."""
    results = result if isinstance(result, Mapping) else {"": result}
    for name, one in results.items() or [("", result)]:
        if not isinstance(one, Shown) or isinstance(one, type):
            what = f"{type(one).__name__} as {name!r}" if name else type(one).__name__
            raise ValueError(
                "result must come from sp.filter, sp.smooth, sp.compare, sp.fit, sp.em or the filter of a sp.dual, or "
                f"be a dict of name to such results, got {what}"
            )
    contents = joined({str(name): _in_own_units(one.contents(), theta) for name, one in results.items()})
    if not contents.posteriors and not contents.sections:
        raise ValueError("result holds nothing to show: none of its methods has run")
    if theta is not None and not contents.posteriors:
        raise ValueError("theta is for results of a model of sp.joint; this one shows its parameters without")
    return contents


def _in_own_units(contents: Contents, theta: Any) -> Contents:
    """With the parameters of a joint model apart from its states."""
    for post in contents.posteriors.values():
        check_single(post)
    if theta is None:
        return contents
    apart = joined({name: separate(theta, post) for name, post in contents.posteriors.items()})
    return apart._replace(sections=(*apart.sections, *contents.sections))


def _series(posts: Mapping[str, Posterior], time: Any, axis: str, truth: Any) -> Runs | None:
    """What the figures over time need; nothing where there are none."""
    if posts:
        return runs_of(posts, instants(time, next(iter(posts.values())).y.shape[0]), axis, truth)
    if time is not None or truth is not None:
        raise ValueError("time and truth are for results over a series, which this one does not hold: leave them out")
    return None


def _page(title: str, contents: Contents, runs: Runs | None, tables: Sequence[Any], notes: Sequence[str]) -> str:
    graphs = Graphs()
    x, axis = (np.zeros(0), "") if runs is None else (runs.x, runs.axis)
    run = {} if runs is None else _run(runs)
    used = [{"what": name, "value": str(value)} for name, value in (run | _versions()).items() if value is not None]
    sections = {
        **({} if runs is None else judged(runs)),
        **named(contents.sections, x, axis, graphs),
        **({} if runs is None else drawn(runs, graphs)),
        "Tables": section("tables", "Tables", "", *(table(caption, rows) for caption, rows in tables)),
        "Notes": section("notes", "Notes", "", *(f"<p>{escape(str(note))}</p>" for note in notes)),
        "Run": section("run", "What was run", "" if runs is None else _drawing(runs), table("", used)),
    }
    subtitle = "" if runs is None else _subtitle(runs)
    links = "".join(f'<a href="#{anchor(name)}">{escape(name)}</a>' for name, html in sections.items() if html)
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
<header><div class="inner"><h1>{escape(title)}</h1><div class="soft">{escape(subtitle)}</div></div></header>
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


def _run(runs: Runs) -> dict[str, Any]:
    dtype = next((str(run.mean.dtype) for run in runs.each if run.mean is not None), str(runs.y.dtype))
    methods = ", ".join(run.name for run in runs.each) or None
    return {"method": methods, "samples": number(len(runs.x)), "precision": dtype}


def _versions() -> dict[str, Any]:
    import sigmapoint

    return {
        "sigmapoint": sigmapoint.__version__,
        "jax": jax.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
    }
