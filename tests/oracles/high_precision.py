"""The Kalman filter of a constant linear model at 60 digits, where no rounding of the textbook formulas matters.

R must be diagonal: the elements of y[k] then have independent noises, and by Bayes' rule conditioning on them together
is conditioning on them one after the other, so each update is scalar and no matrix is inverted (Bierman 1977).
The float64 arguments are taken as exact numbers.
"""

from typing import NamedTuple

import numpy as np
from mpmath import mp, mpf

from .gaussian import Array

Vector = list[mpf]
Matrix = list[list[mpf]]


class PreciseResult(NamedTuple):
    mean: Array  # (T, n)  filtered
    std: Array  # (T, n)
    cov: Array  # (T, n, n)
    log_likelihood: float


def exact_vector(a: Array) -> Vector:
    return [mpf(float(value)) for value in a]


def exact_matrix(a: Array) -> Matrix:
    return [exact_vector(line) for line in a]


def dot(a: Vector, b: Vector) -> mpf:
    return mp.fdot(a, b)


def scalar_update(m: Vector, P: Matrix, H: Vector, d: mpf, R: mpf, y: mpf) -> tuple[Vector, Matrix, mpf]:
    """One scalar measurement: the new mean, the new covariance, the log density of y."""
    n = len(m)
    C = [dot(line, H) for line in P]
    S = dot(H, C) + R
    e = y - dot(H, m) - d
    m = [m[i] + C[i] * e / S for i in range(n)]
    P = [[P[i][j] - C[i] * C[j] / S for j in range(n)] for i in range(n)]
    return m, P, -(e * e / S + mp.log(2 * mp.pi * S)) / 2


def time_update(m: Vector, P: Matrix, F: Matrix, b: Vector, Q: Matrix) -> tuple[Vector, Matrix]:
    n = len(m)
    FP = [[dot(F[i], P[j]) for j in range(n)] for i in range(n)]  # P is symmetric: its rows are its columns
    P = [[dot(FP[i], F[j]) + Q[i][j] for j in range(n)] for i in range(n)]
    return [dot(F[i], m) + b[i] for i in range(n)], P


def precise_kalman_filter(
    F: Array, b: Array, Q: Array, H: Array, d: Array, R: Array, m0: Array, P0: Array, y: Array, digits: int = 60
) -> PreciseResult:
    """Filtered means, standard deviations and covariances of a constant model.

    F, Q, P0 (n, n), b, m0 (n,), H (m, n), d (m,), R (m, m) diagonal, y (T, m), NaN where not measured.
    The first operation is the update with y[0]. Raises ValueError if R is not diagonal.
    """
    if np.count_nonzero(R - np.diag(np.diag(R))):
        raise ValueError("R must be diagonal for scalar updates")
    means, stds, covs = [], [], []
    with mp.workdps(digits):
        F_, Q_, H_ = exact_matrix(F), exact_matrix(Q), exact_matrix(H)
        b_, d_, R_ = exact_vector(b), exact_vector(d), exact_vector(np.diag(R))
        m, P, log_likelihood = exact_vector(m0), exact_matrix(P0), mpf(0)
        for k, y_k in enumerate(y):
            if k > 0:
                m, P = time_update(m, P, F_, b_, Q_)
            for i in np.flatnonzero(~np.isnan(y_k)):
                m, P, log_density = scalar_update(m, P, H_[i], d_[i], R_[i], mpf(float(y_k[i])))
                log_likelihood += log_density
            means.append([float(value) for value in m])
            stds.append([float(mp.sqrt(P[i][i])) for i in range(len(m))])
            covs.append([[float(value) for value in line] for line in P])
        return PreciseResult(np.array(means), np.array(stds), np.array(covs), float(log_likelihood))
