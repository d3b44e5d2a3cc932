"""Draw the picture of the README: the state of charge of the bundled cell, from a start 20 points wrong."""

from pathlib import Path

import jax
import matplotlib as mpl
import numpy as np

import sigmapoint as sp
from sigmapoint.problems.battery_case import leaf

mpl.use("Agg")
import matplotlib.pyplot as plt

OUT = Path(__file__).parents[1] / "docs" / "images"


def main() -> None:
    """Identify the cell at 10 and 40 °C, filter the 25 °C run, draw."""
    jax.config.update("jax_enable_x64", True)
    case = leaf()
    reference, post = case.reference, sp.filter(case.model, case.y, case.u, sp.srcdkf())
    hours, soc, band = case.log.time / 3600, 100 * np.asarray(post.mean[:, 0]), 200 * np.asarray(post.std[:, 0])
    fig, axes = plt.subplots(2, 1, figsize=(9, 5), sharex=True, height_ratios=(2, 1), layout="constrained")
    axes[0].fill_between(hours, soc - band, soc + band, alpha=0.3, lw=0, label="±2σ")
    axes[0].plot(hours, soc, lw=1.5, label="estimate")
    axes[0].plot(hours, 100 * reference, "k--", lw=1, label="charge counted from full")
    axes[0].set(ylabel="state of charge [%]", ylim=(-5, 112))
    axes[0].legend(frameon=False, loc="lower left")
    axes[1].fill_between(hours, -band, band, alpha=0.3, lw=0)
    axes[1].plot(hours, soc - 100 * reference, lw=1.2)
    axes[1].axhline(0, color="k", lw=0.8)
    axes[1].set(xlabel="time [h]", ylabel="error [points]", ylim=(-8, 8), xlim=(0, hours[-1]))
    OUT.mkdir(parents=True, exist_ok=True)
    fig.savefig(OUT / "battery.png", dpi=110)


if __name__ == "__main__":
    main()
