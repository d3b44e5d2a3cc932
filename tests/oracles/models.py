"""Ten small smooth nonlinear problems, the same functions for NumPy and JAX.

`problems(xp)` takes the array namespace, `numpy` or `jax.numpy`. Functions are written element by element with Python
numbers, so they follow the dtype of x. Q, R, m0, P0, u are NumPy float64 arrays; u is None, an array, or a dict of
arrays, with leading axis T. Every noise is additive and every covariance positive definite.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from .gaussian import Array, Function, noise_at, row, vector

STEPS = 50


class Problem(NamedTuple):
    name: str
    f: Function  # f(x, u) -> (n,)
    h: Function  # h(x, u) -> (m,)
    Q: Array  # (n, n)
    R: Array  # (m, m)
    m0: Array  # (n,)
    P0: Array  # (n, n)
    T: int
    u: Any


def runge_kutta_4(rate: Callable[[Any], Any], x: Any, dt: float) -> Any:
    """One classical Runge-Kutta step of dx/dt = rate(x)."""
    k1 = rate(x)
    k2 = rate(x + 0.5 * dt * k1)
    k3 = rate(x + 0.5 * dt * k2)
    k4 = rate(x + dt * k3)
    return x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def diagonal(*values: float) -> Array:
    return np.diag(np.array(values, dtype=np.float64))


def growth(xp: Any) -> Problem:
    """Univariate nonstationary growth (Netto, Gimeno, Mendes 1978; Gordon, Salmond, Smith 1993); u is the instant k."""

    def f(x: Any, u: Any) -> Any:
        return x / 2.0 + 25.0 * x / (1.0 + x**2) + 8.0 * xp.cos(1.2 * u)

    def h(x: Any, u: Any) -> Any:
        return x**2 / 20.0

    k = np.arange(STEPS, dtype=np.float64)
    return Problem("growth", f, h, diagonal(1.0), diagonal(1.0), np.array([0.1]), diagonal(2.0), STEPS, k)


def lecture_notes(xp: Any) -> Problem:
    """Lecture notes 6.2 and 6.6, with Q = 0.01 for their 1, so that 5 + x stays positive."""

    def f(x: Any, u: Any) -> Any:
        return xp.sqrt(5.0 + x)

    def h(x: Any, u: Any) -> Any:
        return x**3

    return Problem("lecture_notes", f, h, diagonal(0.01), diagonal(2.0), np.array([2.0]), diagonal(1.0), STEPS, None)


def pendulum(xp: Any) -> Problem:
    """Angle (rad) and rate (rad/s) of a pendulum, its horizontal position observed (Sarkka 2013, example 5.1)."""
    dt, g = 0.05, 9.81

    def f(x: Any, u: Any) -> Any:
        return xp.stack([x[0] + dt * x[1], x[1] - dt * g * xp.sin(x[0])])

    def h(x: Any, u: Any) -> Any:
        return xp.stack([xp.sin(x[0])])

    q = 0.1
    Q = q * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
    return Problem("pendulum", f, h, Q, diagonal(0.1), np.array([0.8, 0.0]), diagonal(0.1, 0.1), STEPS, None)


def coordinated_turn(xp: Any) -> Problem:
    """Position (m), velocity (m/s), turn rate (rad/s) from range and bearing; sinc keeps sin(wT)/w smooth at w = 0."""
    dt = 1.0

    def f(x: Any, u: Any) -> Any:
        px, vx, py, vy, w = x[0], x[1], x[2], x[3], x[4]
        along = dt * xp.sinc(w * (dt / np.pi))  # sin(w dt) / w
        across = 0.5 * w * dt**2 * xp.sinc(w * (0.5 * dt / np.pi)) ** 2  # (1 - cos(w dt)) / w
        c, s = xp.cos(w * dt), xp.sin(w * dt)
        return xp.stack(
            [px + along * vx - across * vy, c * vx - s * vy, py + across * vx + along * vy, s * vx + c * vy, w]
        )

    def h(x: Any, u: Any) -> Any:
        return xp.stack([xp.sqrt(x[0] ** 2 + x[2] ** 2), xp.arctan2(x[2], x[0])])

    G = np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
    Q = np.zeros((5, 5))
    Q[:2, :2], Q[2:4, 2:4], Q[4, 4] = 0.1 * G, 0.1 * G, 1e-5
    R = diagonal(25.0, 1e-4)
    m0 = np.array([1000.0, 10.0, 1000.0, -5.0, 0.05])
    return Problem("coordinated_turn", f, h, Q, R, m0, diagonal(100.0, 10.0, 100.0, 10.0, 1e-3), STEPS, None)


def van_der_pol(xp: Any) -> Problem:
    """Van der Pol oscillator with a known force u; the position is observed."""
    dt, mu = 0.1, 1.0

    def f(x: Any, u: Any) -> Any:
        def rate(x: Any) -> Any:
            return xp.stack([x[1], mu * (1.0 - x[0] ** 2) * x[1] - x[0] + u[0]])

        return runge_kutta_4(rate, x, dt)

    def h(x: Any, u: Any) -> Any:
        return x[:1]

    u = 0.5 * np.sin(0.3 * np.arange(STEPS))[:, None]
    Q, R = diagonal(1e-4, 1e-2), diagonal(0.04)
    return Problem("van_der_pol", f, h, Q, R, np.array([1.0, 0.0]), diagonal(0.5, 0.5), STEPS, u)


def lorenz_63(xp: Any) -> Problem:
    """Lorenz 1963; the first and the third coordinate are observed."""
    dt = 0.02

    def rate(x: Any) -> Any:
        return xp.stack([10.0 * (x[1] - x[0]), x[0] * (28.0 - x[2]) - x[1], x[0] * x[1] - 8.0 / 3.0 * x[2]])

    def f(x: Any, u: Any) -> Any:
        return runge_kutta_4(rate, x, dt)

    def h(x: Any, u: Any) -> Any:
        return xp.stack([x[0], x[2]])

    Q, R = diagonal(0.02, 0.02, 0.02), diagonal(1.0, 1.0)
    return Problem("lorenz_63", f, h, Q, R, np.array([-6.0, -6.0, 24.0]), diagonal(4.0, 4.0, 4.0), STEPS, None)


def bearings_only(xp: Any) -> Problem:
    """Position (km) and velocity (km/min) of a ship from bearings by a manoeuvring observer, u["observer"] (T, 2)."""
    dt = 1.0

    def f(x: Any, u: Any) -> Any:
        return xp.stack([x[0] + dt * x[2], x[1] + dt * x[3], x[2], x[3]])

    def h(x: Any, u: Any) -> Any:
        return xp.stack([xp.arctan2(x[1] - u["observer"][1], x[0] - u["observer"][0])])

    k = np.arange(STEPS, dtype=np.float64)
    observer = np.stack([0.1 * k, -2.0 + 1.5 * np.sin(0.2 * k)], axis=1)
    Q = np.kron(np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]]), np.eye(2)) * 1e-5
    m0 = np.array([8.0, 6.0, -0.02, 0.03])
    P0 = diagonal(0.5, 0.5, 1e-3, 1e-3)
    return Problem("bearings_only", f, h, Q, diagonal(1e-4), m0, P0, STEPS, {"observer": observer})


def reentry(xp: Any) -> Problem:
    """A vehicle entering the atmosphere, seen by a radar (Julier and Uhlmann 2004, sec. VI), in km and s, Euler steps.

    Their constants; the flight begins lower, where the drag is felt within T steps, and every state has some noise, so
    that Q can be factored.
    """
    dt, earth, scale_height, gravity, beta0 = 0.2, 6374.0, 13.406, 3.9860e5, -0.59783

    def f(x: Any, u: Any) -> Any:
        radius, speed = xp.sqrt(x[0] ** 2 + x[1] ** 2), xp.sqrt(x[2] ** 2 + x[3] ** 2)
        drag = beta0 * xp.exp(x[4] + (earth - radius) / scale_height) * speed
        pull = -gravity / radius**3
        rate = xp.stack([x[2], x[3], drag * x[2] + pull * x[0], drag * x[3] + pull * x[1], 0.0 * x[4]])
        return x + dt * rate

    def h(x: Any, u: Any) -> Any:
        east, north = x[0] - earth, x[1]
        return xp.stack([xp.sqrt(east**2 + north**2), xp.arctan2(north, east)])

    Q = diagonal(1e-6, 1e-6, 2.4064e-5 * dt, 2.4064e-5 * dt, 1e-4 * dt)
    R = diagonal(1e-3, 1e-4)
    m0 = np.array([6424.0, 349.14, -1.8093, -6.7967, 0.6932])
    return Problem("reentry", f, h, Q, R, m0, diagonal(1e-2, 1e-2, 1e-2, 1e-2, 0.1), STEPS, None)


def lotka_volterra(xp: Any) -> Problem:
    """Logarithms of prey and predator; both counts are observed."""
    dt = 0.1

    def rate(x: Any) -> Any:
        return xp.stack([1.0 - 0.5 * xp.exp(x[1]), -1.0 + 0.5 * xp.exp(x[0])])

    def f(x: Any, u: Any) -> Any:
        return runge_kutta_4(rate, x, dt)

    def h(x: Any, u: Any) -> Any:
        return xp.exp(x)

    Q, R = diagonal(1e-3, 1e-3), diagonal(0.05, 0.05)
    return Problem("lotka_volterra", f, h, Q, R, np.array([0.5, 0.2]), diagonal(0.1, 0.1), STEPS, None)


def epidemic(xp: Any) -> Problem:
    """SIR: logit-free shares of susceptible and infected, and the log contact rate (1/day), with vaccination u["rate"].

    The share infected and the daily new cases are observed, in percent.
    """
    dt, recovery = 1.0, 0.1

    def f(x: Any, u: Any) -> Any:
        def rate(x: Any) -> Any:
            new = xp.exp(x[2]) * x[0] * x[1]
            return xp.stack([-new - u["rate"] * x[0], new - recovery * x[1], 0.0 * x[2]])

        return runge_kutta_4(rate, x, dt)

    def h(x: Any, u: Any) -> Any:
        return xp.stack([100.0 * x[1], 100.0 * xp.exp(x[2]) * x[0] * x[1]])

    rate = np.where(np.arange(STEPS) > 25, 0.01, 0.0)
    Q, R = diagonal(1e-6, 1e-6, 1e-3), diagonal(0.25, 0.25)
    m0 = np.array([0.95, 0.03, np.log(0.3)])
    return Problem("epidemic", f, h, Q, R, m0, diagonal(1e-4, 1e-4, 0.05), STEPS, {"rate": rate})


BUILDERS = (
    growth,
    lecture_notes,
    pendulum,
    coordinated_turn,
    van_der_pol,
    lorenz_63,
    bearings_only,
    reentry,
    lotka_volterra,
    epidemic,
)
NAMES = tuple(builder.__name__ for builder in BUILDERS)


def problems(xp: Any = np) -> dict[str, Problem]:
    """The ten problems by name, over the namespace xp."""
    return {builder.__name__: builder(xp) for builder in BUILDERS}


def simulate(problem: Problem, seed: int) -> tuple[Array, Array]:
    """One draw of the states (T, n) and the data (T, m); x[0] ~ N(m0, P0)."""
    draw = partial(np.random.default_rng(seed).multivariate_normal, method="cholesky")
    x, states, data = draw(problem.m0, problem.P0), [], []
    for k in range(problem.T):
        u = row(problem.u, k)
        y = vector(problem.h(x, u))
        states.append(x)
        data.append(y + draw(np.zeros(len(y)), noise_at(problem.R, k)))
        x = vector(problem.f(x, u)) + draw(np.zeros(len(x)), noise_at(problem.Q, k))
    return np.array(states), np.array(data)
