"""Kalman filter, Rauch-Tung-Striebel smoother, and both at once as one large Gaussian.

x[k+1] = F[k] x[k] + b[k] + w,  w ~ N(0, Q[k]);    y[k] = H[k] x[k] + d[k] + v,  v ~ N(0, R[k]);    x[0] ~ N(m0, P0).

Sources: Kalman 1960; the covariance update of Bucy and Joseph 1968; Rauch, Tung, Striebel 1965; S. Sarkka, "Bayesian
Filtering and Smoothing", 2013, Theorems 4.2 and 8.2. Arrays have the leading axis T; row T-1 of F, b, Q is not used.
"""

from typing import NamedTuple

import numpy as np

from .gaussian import Array, Belief, FilterResult, Update, innovation_statistics, run, symmetric


class SmootherResult(NamedTuple):
    mean: Array  # (T, n)
    cov: Array  # (T, n, n)
    lag_one_cov: Array  # (T-1, n, n)  Cov(x[k+1], x[k]) given all of y


class BatchResult(NamedTuple):
    mean: Array  # (T, n)
    cov: Array  # (T, n, n)
    lag_one_cov: Array  # (T-1, n, n)
    log_likelihood: float


def kalman_predict(m: Array, P: Array, F: Array, b: Array, Q: Array) -> Belief:
    return Belief(F @ m + b, symmetric(F @ P @ F.T + Q))


def kalman_update(m: Array, P: Array, H: Array, d: Array, R: Array, y: Array) -> Update:
    """One measurement; Joseph's form adds covariances, but S still rounds: for P >> R use `high_precision`."""
    seen = ~np.isnan(y)
    H_seen, R_seen = H[seen], R[np.ix_(seen, seen)]
    innovation = y - (H @ m + d)
    S = symmetric(H @ P @ H.T + R)
    S_seen = S[np.ix_(seen, seen)]
    K = np.linalg.solve(S_seen, H_seen @ P).T
    A = np.eye(m.size) - K @ H_seen
    nis, log_density = innovation_statistics(innovation[seen], S_seen)
    P_new = symmetric(A @ P @ A.T + K @ R_seen @ K.T)
    return Update(m + K @ innovation[seen], P_new, innovation, S, nis, log_density)


def kalman_filter(
    F: Array, b: Array, Q: Array, H: Array, d: Array, R: Array, m0: Array, P0: Array, y: Array
) -> FilterResult:
    """The Kalman filter; the first operation is the update with y[0] on the belief (m0, P0) about x[0]."""
    return run(
        lambda belief, k: kalman_predict(belief.mean, belief.cov, F[k], b[k], Q[k]),
        lambda belief, y_k, k: kalman_update(belief.mean, belief.cov, H[k], d[k], R[k], y_k),
        m0,
        P0,
        y,
    )


def rts_smoother(F: Array, Q: Array, filtered: FilterResult) -> SmootherResult:
    """Rauch-Tung-Striebel; the covariance as a sum, (I - GF) P (I - GF)' + G (P_s' + Q) G', is never indefinite."""
    T, n = filtered.mean.shape
    mean, cov, lag_one_cov = filtered.mean.copy(), filtered.cov.copy(), np.zeros((T - 1, n, n))
    for k in reversed(range(T - 1)):
        G = np.linalg.solve(filtered.predicted_cov[k + 1], F[k] @ filtered.cov[k]).T
        A = np.eye(n) - G @ F[k]
        mean[k] = filtered.mean[k] + G @ (mean[k + 1] - filtered.predicted_mean[k + 1])
        cov[k] = symmetric(A @ filtered.cov[k] @ A.T + G @ (cov[k + 1] + Q[k]) @ G.T)
        lag_one_cov[k] = cov[k + 1] @ G.T
    return SmootherResult(mean, cov, lag_one_cov)


def trajectory_prior(F: Array, b: Array, Q: Array, m0: Array, P0: Array, T: int) -> tuple[Array, Array]:
    """Mean (T n,) and covariance (T n, T n) of (x[0], ..., x[T-1]) as the linear map of (x[0], w[0], ..., w[T-2])."""
    n = len(m0)
    mean, M = np.zeros((T, n)), np.zeros((T, n, T, n))
    mean[0], M[0, :, 0] = m0, np.eye(n)
    for k in range(T - 1):
        mean[k + 1] = F[k] @ mean[k] + b[k]
        M[k + 1] = np.tensordot(F[k], M[k], axes=1)
        M[k + 1, :, k + 1] = np.eye(n)
    source = np.zeros((T, n, T, n))
    for k in range(T):
        source[k, :, k] = P0 if k == 0 else Q[k - 1]
    M, source = M.reshape(T * n, T * n), source.reshape(T * n, T * n)
    return mean.reshape(-1), M @ source @ M.T


def batch_least_squares(
    F: Array, b: Array, Q: Array, H: Array, d: Array, R: Array, m0: Array, P0: Array, y: Array
) -> BatchResult:
    """Smoothed means and covariances and log p(y) from the joint Gaussian of all states and all data, no recursion.

    The mean is the minimiser of the weighted least-squares cost of the whole record. For small T: cost (T (n + m))^3.
    """
    T, m = y.shape
    n = len(m0)
    mean, cov = trajectory_prior(F, b, Q, m0, P0, T)
    big_H, big_R = np.zeros((T, m, T, n)), np.zeros((T, m, T, m))
    for k in range(T):
        big_H[k, :, k], big_R[k, :, k] = H[k], R[k]
    big_H, big_R = big_H.reshape(T * m, T * n), big_R.reshape(T * m, T * m)
    whole = kalman_update(mean, cov, big_H, d[:T].reshape(-1), big_R, y.reshape(-1))
    blocks = whole.cov.reshape(T, n, T, n)
    diagonal = np.array([blocks[k, :, k] for k in range(T)])
    lag_one = np.array([blocks[k + 1, :, k] for k in range(T - 1)])
    return BatchResult(whole.mean.reshape(T, n), diagonal, lag_one, whole.log_density)
