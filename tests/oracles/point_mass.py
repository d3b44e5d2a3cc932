"""The exact filter of one state on a grid: densities as numbers at equal distances (Bucy & Senne 1971)."""

from typing import NamedTuple

import numpy as np


class Exact(NamedTuple):
    mean: np.ndarray
    std: np.ndarray
    log_likelihood: float
    density: np.ndarray


def point_mass(f, h, q, r, prior, y, low, high, size=4001):
    """`f(x, k)`, `h(x)`; noises `q(w)`, `r(v)` and `prior(x)` as densities; NaN was not measured."""
    x = np.linspace(low, high, size)
    step = x[1] - x[0]
    p = prior(x)
    means, stds, densities, total = [], [], [], 0.0
    for k, value in enumerate(y):
        if not np.isnan(value):
            p = p * r(value - h(x))
            total += np.log(p.sum() * step)
            p = p / (p.sum() * step)
        mean = (x * p).sum() * step
        means.append(mean)
        stds.append(np.sqrt(((x - mean) ** 2 * p).sum() * step))
        densities.append(p)
        p = q(x[:, None] - f(x, k)[None]) @ p * step
    return Exact(np.array(means), np.array(stds), total, np.array(densities))
