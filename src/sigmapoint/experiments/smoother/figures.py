"""The figure of the smoothers: errors by stage."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from sigmapoint.experiments.learning.figures import COLOURS
from sigmapoint.experiments.publishing.results import mean_of
from sigmapoint.experiments.smoother.stages import B, F, S


def bars(
    found: Mapping[str, Mapping[str, Mapping[str, Float[np.ndarray, " R"]]]],
    published: Mapping[str, Mapping[str, tuple[float, float, float]]],
) -> Figure:
    """By series, smoother and stage, of every run; the papers' behind them."""
    figure = Figure(figsize=(11, 4.5), layout="constrained")
    axes = figure.subplots(1, len(found), squeeze=False)[0]
    for axis, (series, each) in zip(axes, found.items()):
        names = list(each)
        for i, stage in enumerate((F, B, S)):
            at = [k for k, name in enumerate(names) if stage in each[name]]
            means = [mean_of(each[names[k]][stage]) for k in at]
            place = np.array(at) + 0.25 * (i - 1)
            axis.bar(
                place, [m.value for m in means], 0.22, yerr=[m.spread for m in means], color=COLOURS[i], label=stage
            )
            for k, name in enumerate(names):
                if name in published[series]:
                    axis.plot(
                        k + 0.25 * (i - 1) + np.array([-0.13, 0.13]), [published[series][name][i]] * 2, c="0.35", lw=2
                    )
        axis.set_xticks(range(len(names)), names, rotation=35, ha="right")
        axis.set_title(series)
        axis.set_ylabel("normalised mean squared error")
        axis.spines[["top", "right"]].set_visible(False)
        axis.set_ylim(0, min(1, axis.get_ylim()[1]))
    axes[-1].legend(frameon=False)
    return figure
