"""A mission of the F-15 in turbulence, during which half of its stabilator's effect is lost: descent, turn, climb.

Each flight is one run of the simulator from beginning to end. An autopilot follows a schedule of climb angle and bank,
by what it knows of the true state: what a filter makes of the measurements does not matter to it. Its commands are
those of

    q_c = 0.6 (γ_c − γ) / cos φ + (g/V) tan φ sin φ,    elevator = −0.05 − (q_c − q) − 1.2 ∫(q_c − q),
    aileron = 0.35 (1.2 (φ_c − φ) − p),                 throttle = 0.6 + 0.02 (200 m/s − V) + 3 γ_c,

limited in size and rate; the rudder is left to the aircraft's own yaw damper. Gusts have each component first order,
as the longitudinal one of Dryden's form is:

    g[k+1] = a g[k] + σ √(1 − a²) ε,    a = exp(−V Δt / L).

Source: MIL-F-8785C (1980), section 3.7.2.2 for Dryden's form, 3.7.3 for the length above 2000 ft.
"""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from sigmapoint.problems.f15_simulator import STEP, Input, Simulator

STEPS = 1200
"""of 0.1 s"""
FAILURE = 650
"""step from which on half of the stabilator's effect is gone"""
LEFT = 0.5
"""of it"""
SPEED = 200.0
"""[m/s]"""
START = np.array([0.0, 0.0, 3000.0, SPEED, 0.0, 8.0, 0.0, 0.04, np.deg2rad(90.0), 0.0, 0.0, 0.0])
"""near level flight to the east"""
START_STD = np.array([100.0, 100.0, 20.0, 2.0, 0.5, 0.5, *np.deg2rad([2.0, 0.5, 2.0, 0.5, 0.5, 0.5])])
"""standard deviations, in the units of the states, from which the start of a flight is drawn"""
FUEL = 2500.0
"""[lb] in each tank at first"""
TURBULENCE = 1.0
"""[m/s] rms of each component"""
LENGTH = 533.0
"""[m] 1750 ft"""
RATE = 120
"""[Hz] of integration, JSBSim's own"""
GRAVITY = 9.81
"""[m/s²]"""
SCHEDULE = np.array([
    (0, 0, 0), (8, -4, 0), (28, -4, 0), (32, 0, 0), (38, 0, 45), (58, 0, 45), (62, 0, 0), (66, 0, 0), (70, 6, 0),
    (84, 6, 0), (88, 0, -30), (100, 0, -30), (104, 4, 0), (116, 4, 0), (120, 0, 0),
])  # fmt: skip
"""time [s], angle of climb [deg], bank [deg]; linear between"""
LOWEST, HIGHEST = np.array([-0.6, -0.4, -0.3, 0.05]), np.array([0.6, 0.4, 0.3, 1.0])
FASTEST = np.array([0.15, 0.15, 0.1, 0.02])
"""change of a command from one step to the next"""


class Flight(NamedTuple):
    """What happened, at each of T instants 0.1 s apart."""

    state: Float[np.ndarray, "*R T 12"]
    """as `Simulator.state`"""
    u: Input
    stabilator: Float[np.ndarray, "*R T"]
    """what is left of its effect"""


class Autopilot:
    """Commands for one flight; it remembers its last one, and the integral."""

    def __init__(self) -> None:
        self.last = np.array([-0.03, 0.0, 0.0, 0.6])
        self._integral = 0.0

    def __call__(self, state: Float[np.ndarray, " 12"], time: float) -> Float[np.ndarray, " 4"]:
        """Elevator, aileron, rudder, throttle from now [s] on."""
        u, v, w, roll, pitch, _, p, q, _ = state[3:]
        speed = np.linalg.norm(state[3:6])
        rising = np.sin(pitch) * u - np.cos(pitch) * (np.sin(roll) * v + np.cos(roll) * w)
        climb, bank = (np.deg2rad(np.interp(time, SCHEDULE[:, 0], column)) for column in SCHEDULE[:, 1:].T)
        wanted = np.clip(0.6 * (climb - np.arcsin(rising / speed)), -0.08, 0.08) / np.cos(roll)
        short = wanted + GRAVITY / speed * np.tan(roll) * np.sin(roll) - q
        self._integral += short * STEP
        elevator = -0.05 - short - 1.2 * self._integral
        aileron = 0.35 * (1.2 * (bank - roll) - p)
        throttle = 0.6 + 0.02 * (SPEED - speed) + 3 * climb
        new = np.clip([elevator, aileron, 0.0, throttle], LOWEST, HIGHEST)
        self.last = self.last + np.clip(new - self.last, -FASTEST, FASTEST)
        return self.last


def gusts(steps: int, key: Array) -> Float[np.ndarray, "T n 3"]:
    """[m/s] north, east, down, for the steps of integration in each step of a filter; still at first."""
    within = round(STEP * RATE)
    a = np.exp(-SPEED / (RATE * LENGTH))
    kicks = TURBULENCE * np.sqrt(1 - a**2) * np.asarray(jax.random.normal(key, (steps * within, 3)))
    blown = np.zeros((steps * within + 1, 3))
    for k, kick in enumerate(kicks):
        blown[k + 1] = a * blown[k] + kick
    return blown[1:].reshape(steps, within, 3)


def flown(steps: int, failure: int, key: Array) -> Flight:
    """One flight of so many steps, with the stabilator failing at one of them."""
    keys = jax.random.split(key)
    start = START + START_STD * np.asarray(jax.random.normal(keys[0], (12,)))
    blown = gusts(steps, keys[1])
    left = np.where(np.arange(steps) < failure, 1.0, LEFT)
    aircraft, autopilot = Simulator(RATE), Autopilot()
    aircraft.place(start, Input(autopilot.last, np.array(FUEL)), np.ones(2))
    states, commands, fuel = [], [], []
    for k in range(steps):
        states.append(aircraft.state())
        fuel.append(aircraft.fuel())
        commands.append(autopilot(states[-1], STEP * k))
        aircraft.command(commands[-1], np.array([left[k], 1.0]))
        aircraft.fly(blown[k])
    return Flight(np.stack(states), Input(np.stack(commands), np.array(fuel)), left)


def flights(count: int, steps: int, failure: int, key: Array) -> Flight:
    """Many of them, with a leading axis."""
    every = [flown(steps, failure, one) for one in jax.random.split(key, count)]
    return jax.tree.map(lambda *each: np.stack(each), *every)
