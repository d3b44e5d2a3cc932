# /// script
# requires-python = ">=3.11"
# dependencies = ["kalman-py[jax]==0.1.1", "jax==0.10.2", "numpy==2.4.6"]
# ///
"""kalman-py: its JAX backend for whole series, and step by step, where it has NumPy alone, all sigma points at a time.

`filter` predicts first, so the update with the first measurement is made with the step-by-step interface beforehand.
"""

import sys
import time
from collections.abc import Callable
from copy import copy
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from kalman_py import ExtendedKalmanFilter, UnscentedKalmanFilter

sys.path.insert(0, str(Path(__file__).parents[1]))
from problems import problem
from worker import serve

jax.config.update("jax_enable_x64", True)
COLUMNS: Any = SimpleNamespace(**vars(np) | {"roll": partial(np.roll, axis=0)})  # for states in columns


def _ukf(name: str, square_root: bool) -> UnscentedKalmanFilter:
    one = problem(name, COLUMNS)
    return UnscentedKalmanFilter(
        lambda x, dt: one.f(x.T).T,
        lambda x: one.h(x.T).T,
        *one[2:],
        square_root=square_root,
        vectorized=True,
    )


def _ekf(name: str, square_root: bool) -> ExtendedKalmanFilter:
    one, traced = problem(name), problem(name, jnp)
    slope_f, slope_h = jax.jit(jax.jacfwd(traced.f)), jax.jit(jax.jacfwd(traced.h))
    return ExtendedKalmanFilter(
        lambda x, dt: one.f(x),
        one.h,
        *one[2:],
        jac_f=lambda x, dt: np.asarray(slope_f(x)),
        jac_h=lambda x: np.asarray(slope_h(x)),
        square_root=square_root,
    )


def _filter(kind: Any, by_step: Any, square_root: bool) -> Any:
    def make(name: str, y: np.ndarray) -> Callable[[], Any]:
        one, first = problem(name, jnp), by_step(name, square_root)
        first.update(y[0])
        rest = kind(lambda x, dt: one.f(x), one.h, one.Q, one.R, first.x, first.P, square_root=square_root)
        y = jnp.asarray(y[1:])

        def run() -> np.ndarray:
            means = jax.block_until_ready(rest.filter(y, dt=1.0, backend="jax").means)
            return np.vstack([first.x, means])

        return run

    return make


def _online(by_step: Any, square_root: bool) -> Any:
    def make(name: str, y: np.ndarray) -> Callable[[], Any]:
        start = by_step(name, square_root)

        def run() -> tuple[np.ndarray, np.ndarray]:
            live, means, seconds = copy(start), [], []
            for row in y:
                begin = time.perf_counter()
                if means:
                    live.predict(1.0)
                live.update(row)
                means.append(live.x)
                seconds.append(time.perf_counter() - begin)
            return np.array(means), np.array(seconds)

        return run

    return make


METHODS = {
    "ukf": (UnscentedKalmanFilter, _ukf, False),
    "srukf": (UnscentedKalmanFilter, _ukf, True),
    "ekf": (ExtendedKalmanFilter, _ekf, False),
    "srekf": (ExtendedKalmanFilter, _ekf, True),
}

if __name__ == "__main__":
    serve(
        filter={name: _filter(*method) for name, method in METHODS.items()},
        online={name: _online(*method[1:]) for name, method in METHODS.items()},
    )
