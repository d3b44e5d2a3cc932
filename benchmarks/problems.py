"""The problems that every library is measured on: functions of one state vector, numbers, and measurements.

Needs NumPy alone, so that every contender can use it in an environment of its own. `xp` is the array module that the
functions are written in: `numpy` or `jax.numpy`.
"""

from collections.abc import Callable
from itertools import count
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np


class Problem(NamedTuple):
    """x' = f(x) + N(0, Q), y = h(x) + N(0, R), and the belief before the first measurement."""

    f: Callable[[Any], Any]
    h: Callable[[Any], Any]
    Q: np.ndarray
    R: np.ndarray
    mean: np.ndarray
    cov: np.ndarray


def turn(xp: ModuleType = np) -> Problem:
    """A coordinated turn: five states, seen in range and bearing (as in `eigen/ukf.cpp`)."""

    def f(x: Any) -> Any:
        w = x[4]
        s, c = xp.sin(w), xp.cos(w)
        return xp.stack(
            [
                x[0] + s / w * x[1] - (1 - c) / w * x[3],
                c * x[1] - s * x[3],
                x[2] + (1 - c) / w * x[1] + s / w * x[3],
                s * x[1] + c * x[3],
                w,
            ]
        )

    def h(x: Any) -> Any:
        return xp.stack([xp.hypot(x[0], x[2]), xp.arctan2(x[2], x[0])])

    move = 0.1 * np.array([[1 / 3, 1 / 2], [1 / 2, 1]])
    Q = np.zeros((5, 5))
    Q[:2, :2] = Q[2:4, 2:4] = move
    Q[4, 4] = 1e-6
    mean, cov = np.array([1000, 30, 1000, 0, 0.05]), np.diag([100, 10, 100, 10, 1e-4])
    return Problem(f, h, Q, np.diag([100, 1e-5]), mean, cov)


def turn_measurements(rows: int, seed: int = 0) -> np.ndarray:
    """Noisy range and bearing of a target on a circle of 600 m about (1000, 1600) m, 0.05 rad/s: no bearing wraps."""
    t = np.arange(rows)
    east, north = 1000 + 600 * np.sin(0.05 * t), 1600 - 600 * np.cos(0.05 * t)
    noise = np.random.default_rng(seed).normal(size=(rows, 2)) * [10, 1e-5**0.5]
    return np.column_stack([np.hypot(east, north), np.arctan2(north, east)]) + noise


def lorenz96(n: int, xp: ModuleType = np) -> Problem:
    """Lorenz-96 with forcing 8, one Euler step of 0.01; every second state is measured."""

    def f(x: Any) -> Any:
        return x + 0.01 * ((xp.roll(x, -1) - xp.roll(x, 2)) * xp.roll(x, 1) - x + 8)

    m = max(n // 2, 1)
    return Problem(f, lambda x: x[::2][:m], 0.01 * np.eye(n), 0.1 * np.eye(m), np.full(n, 8.0), np.eye(n))


def lorenz96_measurements(n: int, rows: int, seed: int = 0) -> np.ndarray:
    """Of a path drawn from the model itself; drawn again where Euler's steps have lost it (of 80 states, sometimes)."""
    one = lorenz96(n)
    y = np.empty((rows, one.R.shape[0]))
    for attempt in count():
        r = np.random.default_rng([seed, attempt])
        x = one.mean + r.normal(size=n)
        for k in range(rows):
            y[k] = one.h(x) + 0.1**0.5 * r.normal(size=one.R.shape[0])
            x = one.f(x) + 0.1 * r.normal(size=n)
            if np.abs(x).max() > 1e3:
                break
        else:
            return y
    raise AssertionError


def growth() -> Problem:
    """A growth model of one state (Kitagawa 1987, without its forcing), seen by how far it is from −2: two modes."""
    one = np.eye(1)
    return Problem(
        lambda x: x / 2 + 25 * x / (1 + x**2), lambda x: (x + 2) ** 2 / 20, 10 * one, one, np.zeros(1), 5 * one
    )


def growth_measurements(rows: int, seed: int = 0) -> np.ndarray:
    """Of a path drawn from the model itself."""
    one, r = growth(), np.random.default_rng(seed)
    x, y = r.normal(size=1) * 5**0.5, np.empty((rows, 1))
    for k in range(rows):
        y[k] = one.h(x) + r.normal(size=1)
        x = one.f(x) + 10**0.5 * r.normal(size=1)
    return y


def problem(name: str, xp: ModuleType = np) -> Problem:
    """`turn`, `growth`, or `lorenz96-8` for eight states."""
    kind, _, states = name.partition("-")
    if kind == "growth":
        return growth()
    return turn(xp) if kind == "turn" else lorenz96(int(states), xp)


def measurements(name: str, rows: int, seed: int = 0) -> np.ndarray:
    """Those of the problem of this name: (rows, m)."""
    kind, _, states = name.partition("-")
    if kind == "growth":
        return growth_measurements(rows, seed)
    return turn_measurements(rows, seed) if kind == "turn" else lorenz96_measurements(int(states), rows, seed)
