"""An unscented particle filter as it is written first: NumPy, with a loop over the particles.

Square roots by Cholesky, sigma points of α = 1, β = 2, κ = 0, weights as logarithms, systematic resampling below half
of the particles, as ours.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from problems import Problem, problem
from worker import serve


def _points(m: np.ndarray, P: np.ndarray) -> np.ndarray:
    L = np.linalg.cholesky(P) * np.sqrt(len(m))
    return np.concatenate([m[None], m + L.T, m - L.T])


def _moments(values: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    n = (len(values) - 1) // 2
    weights = np.full(len(values), 1 / (2 * n))
    weights[0] = 0
    mean = weights @ values
    off = values - mean
    weights[0] = 2  # that of the covariance: 1 - α² + β
    return mean, (off * weights[:, None]).T @ off + noise, off * weights[:, None]


def _log_normal(off: np.ndarray, cov: np.ndarray) -> float:
    L = np.linalg.cholesky(cov)
    white = np.linalg.solve(L, off)
    return -0.5 * white @ white - np.log(np.diag(L)).sum() - len(off) * np.log(2 * np.pi) / 2


def _proposal(one: Problem, m: np.ndarray, P: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    points = _points(m, P)
    predicted, S, weighted = _moments(np.array([one.h(x) for x in points]), one.R)
    gain = np.linalg.solve(S, weighted.T @ (points - m)).T
    P = P - gain @ S @ gain.T
    return m + gain @ (y - predicted), (P + P.T) / 2


def _make(count: int) -> Any:
    def make(name: str, y: np.ndarray) -> Callable[[], Any]:
        one = problem(name)

        def run() -> np.ndarray:
            r, means = np.random.default_rng(0), []
            x, P = np.tile(one.mean, (count, 1)), np.tile(one.cov, (count, 1, 1))
            origin, log_weights = x.copy(), np.full(count, -np.log(count))
            source = one.cov
            for row in y:
                for i in range(count):
                    m, P[i] = _proposal(one, x[i], P[i], row)
                    x[i] = m + np.linalg.cholesky(P[i]) @ r.normal(size=len(m))
                    log_weights[i] += _log_normal(row - one.h(x[i]), one.R)
                    log_weights[i] += _log_normal(x[i] - origin[i], source) - _log_normal(x[i] - m, P[i])
                log_weights -= log_weights.max()
                log_weights -= np.log(np.exp(log_weights).sum())
                weights = np.exp(log_weights)
                means.append(weights @ x)
                if 1 / (weights**2).sum() < count / 2:
                    ancestors = np.searchsorted(np.cumsum(weights), (np.arange(count) + r.uniform()) / count)
                    ancestors = np.minimum(ancestors, count - 1)
                    x, P, log_weights = x[ancestors], P[ancestors], np.full(count, -np.log(count))
                source = one.Q
                for i in range(count):
                    origin[i] = one.f(x[i])
                    x[i], P[i], _ = _moments(np.array([one.f(point) for point in _points(x[i], P[i])]), one.Q)
            return np.array(means)

        return run

    return make


if __name__ == "__main__":
    serve(filter={"upf-200": _make(200)})
