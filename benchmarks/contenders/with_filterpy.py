# /// script
# requires-python = ">=3.11"
# dependencies = ["filterpy==2.0.0", "numpy==2.4.6", "scipy==1.17.1"]
# ///
"""filterpy. It draws the sigma points anew after every prediction; those of the first update are set by hand."""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

sys.path.insert(0, str(Path(__file__).parents[1]))
from problems import problem
from worker import serve


def _start(name: str) -> UnscentedKalmanFilter:
    one = problem(name)
    n, m = len(one.mean), len(one.R)
    points = MerweScaledSigmaPoints(n, alpha=1.0, beta=2.0, kappa=0.0)
    ukf = UnscentedKalmanFilter(n, m, dt=1.0, hx=one.h, fx=lambda x, dt: one.f(x), points=points)
    ukf.x, ukf.P, ukf.Q, ukf.R = one.mean.astype(float), one.cov.astype(float), one.Q, one.R
    ukf.sigmas_f = points.sigma_points(ukf.x, ukf.P)
    return ukf


def _filter(name: str, y: np.ndarray) -> Callable[[], Any]:
    def run() -> np.ndarray:
        ukf, means = _start(name), []
        for row in y:
            if means:
                ukf.predict()
            ukf.update(row)
            means.append(ukf.x)
        return np.array(means)

    return run


def _online(name: str, y: np.ndarray) -> Callable[[], Any]:
    def run() -> tuple[np.ndarray, np.ndarray]:
        ukf, means, seconds = _start(name), [], []
        for row in y:
            begin = time.perf_counter()
            if means:
                ukf.predict()
            ukf.update(row)
            means.append(ukf.x)
            seconds.append(time.perf_counter() - begin)
        return np.array(means), np.array(seconds)

    return run


if __name__ == "__main__":
    serve(filter={"ukf": _filter}, online={"ukf": _online})
