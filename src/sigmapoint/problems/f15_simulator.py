"""The F-15 of the flight simulator JSBSim: placed in any state, flown on, and read again.

The aircraft is JSBSim's own model of it. Two factors are added to a copy: one multiplies pitching moment and lift of
the stabilator's deflection, the other the lift of the angle of attack; both are 1 where nothing has failed.

A state (12) says where the aircraft is and how it moves; what else the simulator remembers is not part of it. Where an
aircraft is placed, surfaces are where the command has them in the end, and the engines turn as the throttle has them in
the end. The simulator itself would start surfaces at zero and engines at full power.

Source: JSBSim, https://jsbsim.sourceforge.net; the aircraft is `f15` of its distribution.
"""

import tempfile
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from sigmapoint import checks

STEP = 0.1
"""[s] of a filter; commands change as often"""
FOOT = 0.3048
"""[m]"""
LATITUDE, LONGITUDE = 34.9, -117.9
"""[deg] where north and east are counted from"""
NAMES = ("north", "east", "altitude", "u", "v", "w", "roll", "pitch", "heading", "p", "q", "r")
UNITS = ("m", "m", "m", "m/s", "m/s", "m/s", "rad", "rad", "rad", "rad/s", "rad/s", "rad/s")
INITIAL = (
    "ic/lat-geod-deg", "ic/long-gc-deg", "ic/h-sl-ft", "ic/u-fps", "ic/v-fps", "ic/w-fps",
    "ic/phi-rad", "ic/theta-rad", "ic/psi-true-rad", "ic/p-rad_sec", "ic/q-rad_sec", "ic/r-rad_sec",
)  # fmt: skip
READ = (
    "position/lat-geod-deg", "position/long-gc-deg", "position/h-sl-ft",
    "velocities/u-aero-fps", "velocities/v-aero-fps", "velocities/w-aero-fps",
    "attitude/phi-rad", "attitude/theta-rad", "attitude/psi-rad",
    "velocities/p-rad_sec", "velocities/q-rad_sec", "velocities/r-rad_sec",
)  # fmt: skip
COMMANDS = ("fcs/elevator-cmd-norm", "fcs/aileron-cmd-norm", "fcs/rudder-cmd-norm", "fcs/throttle-cmd-norm")
SURFACES = ("fcs/elevator-pos-norm", "fcs/aileron-pos-norm", "fcs/rudder-pos-norm")
WIND = ("atmosphere/wind-north-fps", "atmosphere/wind-east-fps", "atmosphere/wind-down-fps")
SECOND = "[1]"
"""after the name of what belongs to the second engine or tank"""
IDLE, FULL = np.array([40.0, 53.0]), np.array([100.0, 100.0])
"""[%] speeds of the two shafts of an engine, of its data sheet: steady ones are linear in the throttle between"""
FACTORS = {
    "aero/factor/stabilator": ("aero/coefficient/Cmde", "aero/coefficient/CLDe"),
    "aero/factor/lift": ("aero/coefficient/CLalpha",),
}
"""properties that are added, and the functions that each multiplies"""
INTEGRATOR, EULER = "simulation/integrator/rate/translational", 1
"""how velocity is integrated: other ways go on with accelerations of before"""
SETTLE = 3
"""rounds of the simulator in which no time passes: accelerations depend on those of the round before, but little"""


class Input(NamedTuple):
    """What is known at an instant, beside measurements."""

    command: Float[np.ndarray, "*T 4"]
    """elevator (positive: nose down), aileron, rudder in [−1, 1], and throttle in [0, 1] until the next instant"""
    fuel: Float[np.ndarray, "*T"]
    """[lb] in each of the two tanks"""


def metres() -> Float[np.ndarray, " 3"]:
    """[m] of a degree of latitude and longitude, and of a foot of altitude, on the WGS 84 ellipsoid."""
    equator, squared = 6378137.0, 6.69437999014e-3
    root = np.sqrt(1 - squared * np.sin(np.deg2rad(LATITUDE)) ** 2)
    meridian, normal = equator * (1 - squared) / root**3, equator / root
    return np.array([np.deg2rad(meridian), np.deg2rad(normal * np.cos(np.deg2rad(LATITUDE))), FOOT])


SCALE = np.concatenate([metres(), np.full(3, FOOT), np.ones(6)])
OFFSET = np.array([LATITUDE, LONGITUDE, *np.zeros(10)])
"""a state is (what the simulator has, less OFFSET) times SCALE"""


class Simulator:
    """One aircraft.

    Args:
        rate: [Hz] of its integration.

    Raises:
        ImportError: JSBSim is not installed.
    """

    def __init__(self, rate: int):
        jsbsim = checks.extra("jsbsim", "the F-15 simulator", "simulator")
        jsbsim.FGJSBBase().debug_lvl = 0
        self._steps = round(STEP * rate)
        self._run = jsbsim.FGFDMExec(None)
        self._run.set_debug_level(0)
        with tempfile.TemporaryDirectory() as folder:
            _copy(Path(jsbsim.get_default_root_dir()) / "aircraft" / "f15" / "f15.xml", Path(folder) / "f15")
            self._run.set_aircraft_path(folder)
            self._run.load_model("f15")
        self._run.set_dt(1.0 / rate)

    def place(self, state: Float[np.ndarray, " 12"], u: Input, factors: Float[np.ndarray, " 2"]) -> None:
        """Begin in a state, in still air, with surfaces and engines steady; nothing of before is left."""
        run = self._run
        run.reset_to_initial_conditions(0)
        self._set(dict(zip(INITIAL, state / SCALE + OFFSET)))
        self._set({"gear/gear-cmd-norm": 0.0, "gear/gear-pos-norm": 0.0})
        self.command(u.command, factors)
        run.run_ic()
        run["propulsion/set-running"] = -1
        self._set(dict(zip(SURFACES, u.command)))
        shafts = IDLE + (FULL - IDLE) * u.command[3]
        for engine in ("", SECOND):
            self._set({f"propulsion/engine{engine}/n{i}": shaft for i, shaft in enumerate(shafts, 1)})
            run[f"propulsion/tank{engine}/contents-lbs"] = u.fuel
        run[INTEGRATOR] = EULER
        run.suspend_integration()
        for _ in range(SETTLE):
            run.run()
        run.resume_integration()

    def command(self, command: Float[np.ndarray, " 4"], factors: Float[np.ndarray, " 2"]) -> None:
        """Command surfaces and both engines from now on, with this left of stabilator and lift."""
        self._set(dict(zip(COMMANDS, command)))
        self._run[COMMANDS[3] + SECOND] = command[3]
        self._set(dict(zip(FACTORS, factors)))

    def fly(self, gusts: Float[np.ndarray, "n 3"] | None = None) -> None:
        """Let a step of a filter pass; `gusts` [m/s] north, east, down for each step of integration, or still air."""
        for k in range(self._steps):
            if gusts is not None:
                self._set(dict(zip(WIND, gusts[k] / FOOT)))
            self._run.run()

    def state(self) -> Float[np.ndarray, " 12"]:
        """North, east, altitude [m]; velocity through the air, forward, right, down [m/s]; roll, pitch, heading [rad];
        their body rates [rad/s]."""
        return (np.array([self._run[name] for name in READ]) - OFFSET) * SCALE

    def fuel(self) -> float:
        """[lb] in each tank."""
        return self._run["propulsion/tank/contents-lbs"]

    def _set(self, properties: dict[str, Any]) -> None:
        for name, value in properties.items():
            self._run[name] = float(value)


def _copy(aircraft: Path, folder: Path) -> None:
    """The aircraft's file with the factors in it."""
    tree = ElementTree.parse(aircraft)
    for factor, functions in FACTORS.items():
        aerodynamics = next(tree.iter("aerodynamics"))
        declared = ElementTree.Element("property", value="1.0")
        declared.text = factor
        aerodynamics.insert(0, declared)
        for function in (f for f in aerodynamics.iter("function") if f.get("name") in functions):
            ElementTree.SubElement(next(function.iter("product")), "property").text = factor
    folder.mkdir()
    tree.write(folder / "f15.xml")


RATE = 60
"""[Hz] of integration in `advanced`: half of JSBSim's own"""


def advanced(state: Float[np.ndarray, " 12"], u: Input, factors: Float[np.ndarray, " 2"]) -> Float[np.ndarray, " 12"]:
    """The state one step later, in still air; what was before does not matter (by less than a millimetre)."""
    aircraft = _aircraft()
    aircraft.place(state, u, factors)
    aircraft.fly()
    return aircraft.state()


@cache
def _aircraft() -> Simulator:
    """One a process, as it takes a while to load."""
    return Simulator(RATE)
