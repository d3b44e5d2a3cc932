"""Parameter estimation as printed: recursive least squares, and the SR-UKF with Cholesky downdates.

van der Merwe & Wan, "The Square-Root Unscented Kalman Filter for State and Parameter-Estimation" (2001), Algorithm 3.2.
"""

import numpy as np


def recursive_least_squares(x, d, w, P, noise, forgetting):
    """Exponentially weighted, one scalar target a row: means after each."""
    means = []
    for a, b in zip(x, d):
        P = P / forgetting
        gain = P @ a / (a @ P @ a + noise)
        w = w + gain * (b - a @ w)
        P = P - np.outer(gain, a @ P)
        means.append(w)
    return np.array(means), P


def cholupdate(S, x, sign):
    """Upper R with RᵀR = SᵀS ± x xᵀ, by (hyperbolic) rotations; raises where there is none."""
    S, x = S.copy(), x.copy()
    for k in range(len(x)):
        square = S[k, k] ** 2 + sign * x[k] ** 2
        if square <= 0:
            raise np.linalg.LinAlgError("downdate of a matrix that is not positive definite")
        r = np.sqrt(square)
        c, s = r / S[k, k], x[k] / S[k, k]
        S[k, k] = r
        S[k, k + 1 :] = (S[k, k + 1 :] + sign * s * x[k + 1 :]) / c
        x[k + 1 :] = c * x[k + 1 :] - s * S[k, k + 1 :]
    return S


def square_root_ukf(function, w, S, pairs, noise, forgetting, alpha=1.0, beta=2.0, kappa=0.0):
    """Means and lower factors after each pair."""
    L = len(w)
    lam = alpha**2 * (L + kappa) - L
    wm = np.full(2 * L + 1, 0.5 / (L + lam))
    wc = wm.copy()
    wm[0] = lam / (L + lam)
    wc[0] = wm[0] + 1 - alpha**2 + beta
    root = np.linalg.cholesky(noise)
    found = []
    for x, d in pairs:
        S = S / np.sqrt(forgetting)
        W = np.concatenate([w[None], w + np.sqrt(L + lam) * S.T, w - np.sqrt(L + lam) * S.T])
        D = np.array([function(v, x) for v in W])
        mean = wm @ D
        R = np.linalg.qr(np.concatenate([np.sqrt(wc[1]) * (D[1:] - mean), root.T]), mode="r")
        R = R * np.where(np.diag(R) < 0, -1, 1)[:, None]
        R = cholupdate(R, np.sqrt(abs(wc[0])) * (D[0] - mean), np.sign(wc[0]))
        P_wd = (W - w).T @ (wc[:, None] * (D - mean))
        K = np.linalg.solve(R, np.linalg.solve(R.T, P_wd.T)).T
        w = w + K @ (d - mean)
        upper = S.T
        for u in (K @ R.T).T:
            upper = cholupdate(upper, u, -1)
        S = upper.T
        found.append((w, S))
    return [np.array(part) for part in zip(*found)]
