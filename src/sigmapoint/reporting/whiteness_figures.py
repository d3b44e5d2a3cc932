"""Figures of the tests of innovations: autocorrelation, histogram, QQ plot. Each returns a `plotly` figure."""

import numpy as np
import plotly.graph_objects as go

from sigmapoint.diagnosis.whiteness import Element, quantiles
from sigmapoint.reporting.runs import Run, Runs
from sigmapoint.reporting.traces import REFERENCE, plain

EDGE = 5.0
"""Histograms span ± this; what is outside counts in the last bin."""
WHOLE = 2.0
"""A band as wide as this holds every correlation."""


def autocorrelation_figure(runs: Runs, j: int) -> go.Figure:
    """Autocorrelation of the normalised innovation `j` with the band of white noise."""
    figure = plain("lag [samples]", "autocorrelation")
    elements = _elements(runs, j)
    for run, element in elements:
        lags = np.arange(1, element.autocorrelation.size + 1)
        figure.add_trace(go.Bar(x=lags, y=element.autocorrelation, name=run.name, marker={"color": run.style.color}))
    if elements:
        band = np.minimum(elements[0][1].band, WHOLE)  # one a lag: as wide as the pairs so far apart are few
        edges = np.arange(band.size + 1) + 0.5
        for edge in (band, -band):
            figure.add_trace(_reference(edges, np.append(edge, edge[-1:]), "95 % of white noise", shape="hv"))
        sizes = [1.1 * float(np.abs(e.autocorrelation).max(initial=0)) for _, e in elements]
        top = min(max([2.5 * band.min(initial=WHOLE), 0.1, *sizes]), 1.05)
        figure.update_yaxes(range=[-top, top])
    return figure.update_layout(showlegend=len(elements) > 1)


def histogram_figure(runs: Runs, j: int) -> go.Figure:
    """Density of the normalised innovation `j` and of a standard normal."""
    figure = plain("normalised innovation [σ]", "density")
    elements = _elements(runs, j)
    for run, element in elements:
        known = element.white[np.isfinite(element.white)]
        bins = int(np.clip(2 * known.size ** (1 / 3), 8, 50))
        density, edges = np.histogram(np.clip(known, -EDGE, EDGE), bins, (-EDGE, EDGE), density=True)
        middle = (edges[1:] + edges[:-1]) / 2
        if len(elements) == 1:
            figure.add_trace(
                go.Bar(x=middle, y=density, name="innovations", marker={"color": run.style.color}, width=10 / bins)
            )
        else:
            line = {"color": run.style.color, "dash": run.style.dash, "shape": "hvh"}
            figure.add_trace(go.Scatter(x=middle, y=density, name=run.name, mode="lines", line=line))
    x = np.linspace(-EDGE, EDGE, 121)
    figure.add_trace(_reference(x, np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi), "standard normal", dash="solid"))
    return figure.update_layout(showlegend=len(elements) > 1, bargap=0)


def qq_figure(runs: Runs, j: int) -> go.Figure:
    """Quantiles of the normalised innovation `j` against those of a standard normal: on the line if Gaussian."""
    figure = plain("quantile of a standard normal", "quantile of the innovations [σ]")
    elements = _elements(runs, j)
    for run, element in elements:
        at, values = quantiles(element.white)
        figure.add_trace(
            go.Scatter(x=at, y=values, name=run.name, mode="markers", marker={"color": run.style.color, "size": 4})
        )
    figure.add_trace(_reference(np.array([-4.0, 4.0]), np.array([-4.0, 4.0]), "standard normal"))
    return figure.update_layout(showlegend=len(elements) > 1)


def _elements(runs: Runs, j: int) -> list[tuple[Run, Element]]:
    return [
        (run, run.diagnosis.elements[j]) for run in runs.each if run.diagnosis and run.diagnosis.elements[j].samples
    ]


def _reference(x: np.ndarray, y: np.ndarray, name: str, dash: str = "dot", shape: str = "linear") -> go.Scatter:
    line = {"color": REFERENCE, "width": 1.6, "dash": dash, "shape": shape}
    return go.Scatter(x=x, y=y, name=name, mode="lines", line=line, showlegend=False, hoverinfo="skip")
