# /// script
# requires-python = ">=3.11"
# dependencies = ["filterpy==2.0.0", "numpy==2.4.6", "scipy==1.17.1"]
# ///
"""filterpy's unscented filter on the weights of a tanh network: `learning_filterpy.py FILE UNITS`, for `learning.py`.

FILE has w (L,), x (N, 2), d (N, 2) and the variances `prior` and `noise`. Prints JSON: the seconds of each update, and
the last mean.
"""

import json
import sys
import time
from typing import Any

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter


def main(file: str, units: int) -> None:
    """Learn from all pairs."""
    given = np.load(file)
    L, (A, a, B) = len(given["w"]), np.cumsum([2 * units, units, 2 * units])

    def network(w: Any, x: Any) -> Any:
        hidden = np.tanh(w[:A].reshape(units, 2) @ x + w[A:a])
        return w[a:B].reshape(2, units) @ hidden + w[B:]

    points = MerweScaledSigmaPoints(L, alpha=1.0, beta=2.0, kappa=0.0)
    ukf = UnscentedKalmanFilter(L, 2, dt=1.0, hx=network, fx=lambda w, dt: w, points=points)
    ukf.x, ukf.P, ukf.R = given["w"].astype(float), given["prior"] * np.eye(L), given["noise"] * np.eye(2)
    ukf.Q = np.zeros((L, L))
    seconds = []
    for x, d in zip(given["x"], given["d"]):
        begin = time.perf_counter()
        ukf.predict()
        ukf.update(d, x=x)
        seconds.append(time.perf_counter() - begin)
    print(json.dumps({"seconds": seconds, "mean": ukf.x.tolist()}))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
