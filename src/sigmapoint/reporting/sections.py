"""The sections of the report page, each a string of HTML, empty where there is nothing to show."""

from html import escape
from typing import Any

import numpy as np

from sigmapoint.plotting import SHOWN
from sigmapoint.reporting.figures import error_figure, innovation_figure, measurement_figure, nis_figure, state_figure
from sigmapoint.reporting.html import Graphs, badge, card, few, grid, grid_of, number, section, table, verdict_list
from sigmapoint.reporting.runs import Run, Runs
from sigmapoint.reporting.whiteness_figures import autocorrelation_figure, histogram_figure, qq_figure

BAND = "expected {:.2f} to {:.2f}"
VIEW = "At first the rarest large values may be out of view: double-click to see all, and again to go back."


def judged(runs: Runs) -> dict[str, str]:
    """How runs of a filter went, in numbers and words, by the name of the link."""
    return {"Summary": summary(runs), "Trust": trust(runs)}


def drawn(runs: Runs, graphs: Graphs) -> dict[str, str]:
    """Figures of runs of a filter, by the name of the link."""
    return {
        "States": states(runs, graphs),
        "Accuracy": accuracy(runs, graphs),
        "Measurements": innovations(runs, graphs),
        "NIS": nis(runs, graphs),
        "Whiteness": whiteness(runs, graphs),
    }


def summary(runs: Runs) -> str:
    """Cards for one method, a table for several."""
    if len(runs.each) > 1:
        return section("summary", "Summary", "", table("", [_row(run, runs) for run in runs.each]))
    run = runs.each[0]
    cards = [card("Samples", len(runs.x), _measured(runs)), card("Log-likelihood", run.log_likelihood)]
    if run.diagnosis and run.diagnosis.nis.rows:
        found = run.diagnosis.nis
        cards.append(card("Mean NIS per measured element", f"{found.mean:.3g}", BAND.format(*found.band)))
        cards.append(card("Samples within their 95 % band", f"{100 * found.inside:.1f} %", "of the NIS; expected 95 %"))
    if run.diagnosis and run.diagnosis.nees and run.diagnosis.nees.rows:
        found = run.diagnosis.nees
        cards.append(card("Mean NEES per state", f"{found.mean:.3g}", BAND.format(*found.band)))
    rms = [(name, value) for name, value in _rms(run, runs).items() if np.isfinite(value)]
    cards += [
        card(f"RMS error of {name}", f"{value:.4g}", "" if unit == "1" else unit) for (name, unit), value in rms[:3]
    ]
    return section("summary", "Summary", "", f'<div class="cards">{"".join(cards)}</div>')


def trust(runs: Runs) -> str:
    """Verdicts in plain words."""
    judged = [(run, run.diagnosis.verdicts) for run in runs.each if run.diagnosis]
    if not judged:
        text = "Innovations were not kept (innovation, innovation_cov, nis), so nothing here checks the filter."
        return section("trust", "Can this be trusted?", "", f'<p class="soft">{text}</p>')
    text = "Bands are 95 % bands for a model that is right. Differences that are too small to matter count as good."
    if len(judged) == 1:
        return section("trust", "Can this be trusted?", text, verdict_list(judged[0][1]))
    parts = [
        f"<details{' open' if i == 0 else ''}><summary>{escape(run.name)}{badge(said)}</summary>"
        f"{verdict_list(said)}</details>"
        for i, (run, said) in enumerate(judged)
    ]
    return section("trust", "Can this be trusted?", text, *parts)


def states(runs: Runs, graphs: Graphs) -> str:
    """Every state with its band; the first 12 of many."""
    names, drawn = runs.labels.states, min(len(runs.labels.states), SHOWN)
    if all(run.mean is None for run in runs.each):
        return ""
    truth = " Dashed: the truth." if runs.truth is not None else ""
    text = f"Line: the estimate. Band: ±2 standard deviations as the filter states them.{truth} "
    text += "Drag to zoom, double-click to go back; all time series zoom together. Click a legend entry to hide it."
    return section(
        "states",
        "States",
        text,
        few(drawn, len(names), "states"),
        grid_of([graphs.figure(names[i], state_figure(runs, i)) for i in range(drawn)]),
    )


def accuracy(runs: Runs, graphs: Graphs) -> str:
    """Errors against the truth, as numbers and against ±2σ."""
    if all(run.error is None for run in runs.each):
        return ""
    rows = [row for run in runs.each for row in _coverage_rows(run, runs)]
    names = list(zip(*runs.errors))
    known = [i for i, _ in enumerate(names) if any(run.coverage[i].samples for run in runs.each if run.coverage)]
    figures = [graphs.figure(f"Error of {names[i][0]}", error_figure(runs, i, *names[i])) for i in known[:SHOWN]]
    text = (
        "Error: truth minus estimate. A filter that knows its limits stays within ±2σ about 95 % of the time. " + VIEW
    )
    listed = table("", rows)
    return section("accuracy", "Accuracy", text, listed, few(len(figures), len(known), "states"), grid_of(figures))


def innovations(runs: Runs, graphs: Graphs) -> str:
    """Measurements against predictions, and their difference against ±2σ."""
    repeated, runs = _repeated(runs), runs.distinct
    measured, surprises = runs.labels.observations, runs.innovations.names
    total = max(len(measured), len(surprises))
    drawn = min(total, SHOWN)
    if not surprises:
        return ""
    figures = []
    for j in range(drawn):
        if j < len(measured):
            figures.append(graphs.figure(measured[j], measurement_figure(runs, j), "measured and predicted"))
        if j < len(surprises):
            figures.append(graphs.figure(surprises[j], innovation_figure(runs, j), "innovation against ±2σ"))
    text = (
        "Innovation: measurement minus what the filter expected just before it. It should stay within ±2σ about 95 % "
    )
    text += "of the time and show no pattern. " + VIEW + repeated
    some = few(drawn, total, "measured quantities")
    return section("measurements", "Measurements and innovations", text, some, grid("two", figures))


def nis(runs: Runs, graphs: Graphs) -> str:
    """Normalised innovations squared."""
    runs = runs.distinct
    if all(run.nis is None or run.degrees is None for run in runs.each):
        return ""
    text = "Normalised innovation squared (NIS): how large each surprise is, compared with what the filter expected. "
    text += (
        "The running mean should stay near the number of measured elements; above is overconfident, below is cautious."
    )
    return section("nis", "Consistency", text, grid("", [graphs.figure("NIS", nis_figure(runs), "logarithmic")]))


def whiteness(runs: Runs, graphs: Graphs) -> str:
    """Autocorrelation, histogram and QQ plot of each measured quantity, and what follows an input."""
    runs = runs.distinct
    judged = [run for run in runs.each if run.diagnosis and any(e.samples > 3 for e in run.diagnosis.elements)]
    if not judged:
        return ""
    labels = runs.innovations.names
    drawn = min(len(labels), SHOWN)
    parts = []
    for j in range(drawn):
        three = [
            graphs.figure("Autocorrelation", autocorrelation_figure(runs, j), labels[j]),
            graphs.figure("Histogram", histogram_figure(runs, j), labels[j]),
            graphs.figure("QQ plot", qq_figure(runs, j), labels[j]),
        ]
        parts.append(grid("three", three))
    rows = [row for run in judged for row in _input_rows(run)]
    if rows:
        parts.append(table("Correlation of innovations with the inputs", rows))
    text = "If the model is right, normalised innovations are uncorrelated in time (bars within the dotted lines) and "
    text += "Gaussian (bars under the curve, points on the line)."
    some = few(drawn, len(labels), "measured quantities")
    return section("whiteness", "Are the innovations white?", text, some, *parts)


def _row(run: Run, runs: Runs) -> dict[str, Any]:
    row: dict[str, Any] = {"method": run.name, "log-likelihood": run.log_likelihood}
    if run.diagnosis:
        row["mean NIS"] = run.diagnosis.nis.mean
        row["NIS inside 95 % band"] = f"{100 * run.diagnosis.nis.inside:.1f} %"
    if run.diagnosis and run.diagnosis.nees:
        row["mean NEES"] = run.diagnosis.nees.mean
    finite = [(name, value) for name, value in _rms(run, runs).items() if np.isfinite(value)]
    return row | {
        f"RMS error {name}{f' [{unit}]' if unit not in ('', '1') else ''}": v for (name, unit), v in finite[:4]
    }


def _rms(run: Run, runs: Runs) -> dict[tuple[str, str], float]:
    return {(found.name, unit): found.rms for found, unit in zip(run.coverage, runs.errors.units)}


def _coverage_rows(run: Run, runs: Runs) -> list[dict[str, Any]]:
    rows = []
    for found, unit in zip(run.coverage, runs.errors.units):
        if not found.samples:
            continue
        row: dict[str, Any] = {"method": run.name} if run.name else {}
        row |= {"state": found.name, "unit": unit, "RMS error": found.rms, "largest": found.largest}
        row |= {"mean of own σ": found.std}
        shares = zip(("±1σ (68.3 %)", "±2σ (95.4 %)", "±3σ (99.7 %)"), found.within)
        rows.append(row | {f"within {bars}": f"{100 * share:.1f} %" for bars, share in shares})
    return rows


def _input_rows(run: Run) -> list[dict[str, Any]]:
    found = run.diagnosis.elements if run.diagnosis else ()
    return [
        ({"method": run.name} if run.name else {})
        | {"measured": e.name, "input": i.column, "correlation": f"{i.correlation:+.3f}", "95 % band": f"±{i.band:.3f}"}
        for e in found
        for i in e.inputs
    ]


def _measured(runs: Runs) -> str:
    missing = int(np.isnan(runs.y).sum())
    return f"{number(missing)} of {number(int(runs.y.size))} values missing" if missing else "every value measured"


def _repeated(runs: Runs) -> str:
    said = [f"{name} has those of {first}" for name, first in runs.repeated.items()]
    listed = escape(", ".join(said))
    return f" Shown once: {listed}; a smoother's innovations are its filter's." if said else ""
