"""The Rauch-Tung-Striebel smoother of any additive-noise Gaussian filter.

Source: S. Sarkka, "Unscented Rauch-Tung-Striebel Smoother", IEEE Trans. Automatic Control 53, 2008; "Bayesian Filtering
and Smoothing", 2013, chapter 10.
"""

from typing import Any

import numpy as np

from .gaussian import Array, FilterResult, Function, Transform, noise_at, row, symmetric
from .kalman import SmootherResult


def gaussian_smoother(
    transform: Transform, f: Function, Q: Array, filtered: FilterResult, u: Any = None
) -> SmootherResult:
    """Smoothed beliefs from the filtered ones; row k of `filtered` must be instant k (`first="update"`)."""
    T, n = filtered.mean.shape
    mean, cov, lag_one_cov = filtered.mean.copy(), filtered.cov.copy(), np.zeros((T - 1, n, n))
    for k in reversed(range(T - 1)):
        moments = transform(lambda x, k=k: f(x, row(u, k)), filtered.mean[k], filtered.cov[k])
        predicted_cov = moments.cov + noise_at(Q, k)
        G = np.linalg.solve(predicted_cov, moments.cross.T).T
        mean[k] = filtered.mean[k] + G @ (mean[k + 1] - moments.mean)
        cov[k] = symmetric(filtered.cov[k] + G @ (cov[k + 1] - predicted_cov) @ G.T)
        lag_one_cov[k] = cov[k + 1] @ G.T
    return SmootherResult(mean, cov, lag_one_cov)
