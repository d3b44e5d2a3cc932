# /// script
# requires-python = ">=3.11"
# dependencies = ["stonesoup==1.9.1", "numpy==2.4.6", "scipy==1.17.1"]
# ///
"""Stone Soup: its unscented predictor and updater; the models take all sigma points at a time, as its own do."""

import sys
import time
from collections.abc import Callable
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.models.base import GaussianModel
from stonesoup.models.measurement import MeasurementModel
from stonesoup.models.transition import TransitionModel
from stonesoup.predictor.kalman import UnscentedKalmanPredictor
from stonesoup.types.array import StateVector, StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.updater.kalman import UnscentedKalmanUpdater

sys.path.insert(0, str(Path(__file__).parents[1]))
from problems import problem
from worker import serve

COLUMNS: Any = SimpleNamespace(**vars(np) | {"roll": partial(np.roll, axis=0)})
SPREAD = {"alpha": 1.0, "beta": 2.0, "kappa": 0.0}
BEGIN, STEP = datetime(2000, 1, 1), timedelta(seconds=1)


class Move(TransitionModel, GaussianModel):
    """x' = f(x) + N(0, Q)."""

    f: Callable[[Any], Any] = Property()
    Q: np.ndarray = Property()

    @property
    def ndim_state(self) -> int:
        return len(self.Q)

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> StateVectors:
        return self.f(np.asarray(state.state_vector)).view(StateVectors)

    def covar(self, **kwargs: Any) -> np.ndarray:
        return self.Q


class Look(MeasurementModel, GaussianModel):
    """y = h(x) + N(0, R)."""

    h: Callable[[Any], Any] = Property()
    R: np.ndarray = Property()

    @property
    def ndim_meas(self) -> int:
        return len(self.R)

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> StateVectors:
        return self.h(np.asarray(state.state_vector)).view(StateVectors)

    def covar(self, **kwargs: Any) -> np.ndarray:
        return self.R


def _parts(name: str) -> tuple[UnscentedKalmanPredictor, UnscentedKalmanUpdater, Callable[[], GaussianStatePrediction]]:
    one = problem(name, COLUMNS)
    n = len(one.mean)
    predictor = UnscentedKalmanPredictor(Move(f=one.f, Q=one.Q), **SPREAD)
    updater = UnscentedKalmanUpdater(Look(ndim_state=n, mapping=range(n), h=one.h, R=one.R), **SPREAD)
    mean, cov = StateVector(one.mean.astype(float)), one.cov.astype(float)
    return predictor, updater, lambda: GaussianStatePrediction(mean, cov, timestamp=BEGIN)


def _online(name: str, y: np.ndarray) -> Callable[[], Any]:
    predictor, updater, start = _parts(name)
    times = [BEGIN + k * STEP for k in range(len(y))]

    def run() -> tuple[np.ndarray, np.ndarray]:
        state, means, seconds = start(), [], []
        for row, now in zip(y, times, strict=True):
            begin = time.perf_counter()
            if means:
                state = predictor.predict(state, timestamp=now)
            state = updater.update(SingleHypothesis(state, Detection(StateVector(row), timestamp=now)))
            means.append(state.state_vector[:, 0])
            seconds.append(time.perf_counter() - begin)
        return np.array(means), np.array(seconds)

    return run


def _filter(name: str, y: np.ndarray) -> Callable[[], Any]:
    predictor, updater, start = _parts(name)
    seen = [Detection(StateVector(row), timestamp=BEGIN + k * STEP) for k, row in enumerate(y)]

    def run() -> np.ndarray:
        state, means = start(), []
        for detection in seen:
            if means:
                state = predictor.predict(state, timestamp=detection.timestamp)
            state = updater.update(SingleHypothesis(state, detection))
            means.append(state.state_vector[:, 0])
        return np.array(means)

    return run


if __name__ == "__main__":
    serve(filter={"ukf": _filter}, online={"ukf": _online})
