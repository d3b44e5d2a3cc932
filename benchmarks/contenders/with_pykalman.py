# /// script
# requires-python = ">=3.11"
# dependencies = ["pykalman==0.11.2", "numpy==2.4.6", "scipy==1.17.1"]
# ///
"""pykalman. Its sigma points cannot be set: alpha 1, beta 0, kappa 3 - n, so the means differ a little."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from pykalman import AdditiveUnscentedKalmanFilter

sys.path.insert(0, str(Path(__file__).parents[1]))
from problems import problem
from worker import serve


def _filter(name: str, y: np.ndarray) -> Callable[[], Any]:
    one = problem(name)
    ukf = AdditiveUnscentedKalmanFilter(one.f, one.h, one.Q, one.R, one.mean, one.cov)
    return lambda: ukf.filter(y)[0]


if __name__ == "__main__":
    serve(filter={"ukf": _filter})
