"""A step of expectation-maximisation for a linear model with constant matrices, by inverses and sums.

Source: R. H. Shumway, D. S. Stoffer, "An approach to time series smoothing and forecasting using the EM algorithm",
J. Time Series Analysis 3 (1982); as in their "Time Series Analysis and Its Applications", 2011, section 6.3.
"""

from typing import NamedTuple

import numpy as np

from .gaussian import Array, symmetric
from .kalman import kalman_filter, rts_smoother


class Linear(NamedTuple):
    """x[k+1] = A x[k] + w, y[k] = H x[k] + v."""

    A: Array
    Q: Array
    H: Array
    R: Array
    m0: Array
    P0: Array


def em_step(model: Linear, y: Array, transition: bool = False) -> tuple[Linear, float]:
    """The model after a step, and the log-likelihood before it; rows of y are whole or missing whole."""
    A, Q, H, R, m0, P0 = model
    T, m = y.shape
    n = len(m0)
    F, Qs, Hs, Rs = (np.tile(M, (T, 1, 1)) for M in (A, Q, H, R))
    filtered = kalman_filter(F, np.zeros((T, n)), Qs, Hs, np.zeros((T, m)), Rs, m0, P0, y)
    s = rts_smoother(F, Qs, filtered)
    outer = s.cov + np.einsum("ki,kj->kij", s.mean, s.mean)
    S11, S00 = outer[1:].sum(0), outer[:-1].sum(0)
    S10 = s.lag_one_cov.sum(0) + s.mean[1:].T @ s.mean[:-1]
    A = np.linalg.solve(S00, S10.T).T if transition else A
    Q = symmetric(S11 - A @ S10.T - S10 @ A.T + A @ S00 @ A.T) / (T - 1)
    there = ~np.isnan(y).any(axis=1)
    e = y[there] - s.mean[there] @ H.T
    R = symmetric(e.T @ e + (H @ s.cov[there] @ H.T).sum(0)) / there.sum()
    return Linear(A, Q, H, R, s.mean[0], s.cov[0]), filtered.log_likelihood
