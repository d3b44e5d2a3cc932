"""The F-15 of the flight simulator: that a step depends on its arguments alone, and is the aircraft's."""

import tempfile

import jax
import numpy as np
import pytest

from sigmapoint.problems import f15, f15_mission, f15_simulator
from sigmapoint.problems.f15_mission import START
from sigmapoint.problems.f15_simulator import Input, Simulator, advanced

pytest.importorskip("jsbsim")

U = Input(np.array([-0.1, 0.05, 0.02, 0.7]), np.array(2400.0))
WHOLE, HALF = np.ones(2), np.array([0.5, 1.0])
TURNING = START + np.array([500.0, -300.0, 200.0, 5.0, 1.0, 2.0, 0.4, 0.1, 0.3, 0.02, 0.03, 0.01])


@pytest.fixture(scope="module")
def aircraft():
    return Simulator(f15_simulator.RATE)


def test_a_state_that_is_placed_is_read_again(aircraft):
    aircraft.place(TURNING, U, WHOLE)
    # The simulator's way from latitude, longitude and altitude to a place and back is good to a millimetre.
    np.testing.assert_allclose(aircraft.state()[:3], TURNING[:3], atol=1e-3)
    np.testing.assert_allclose(aircraft.state()[3:], TURNING[3:], rtol=1e-6, atol=1e-6)
    assert aircraft.fuel() == U.fuel


def test_a_step_depends_on_its_arguments_alone():
    first = advanced(TURNING, U, WHOLE)
    other = Input(np.array([0.3, -0.3, 0.2, 1.0]), np.array(500.0))
    for _ in range(3):
        advanced(START, other, HALF)
    # A millimetre again: the first step of all begins in another place by so much.
    np.testing.assert_allclose(advanced(TURNING, U, WHOLE), first, rtol=0, atol=1e-3)


def test_velocity_and_rates_move_the_aircraft():
    moved = advanced(START, U._replace(command=np.array([-0.05, 0.0, 0.0, 0.6])), WHOLE)
    speed = np.hypot(START[3], START[5])
    assert moved[1] - START[1] == pytest.approx(speed * f15_simulator.STEP, rel=0.01)
    assert abs(moved[0] - START[0]) < 0.1


def test_half_a_stabilator_turns_the_nose_half_as_fast():
    def kick(factors):
        up, level = (
            advanced(START, U._replace(command=np.array([elevator, 0.0, 0.0, 0.6])), factors)[10]
            for elevator in (-0.2, 0.0)
        )
        return up - level

    assert kick(WHOLE) > 0.02
    assert kick(HALF) / kick(WHOLE) == pytest.approx(0.5, abs=0.02)  # the rate itself is damped a little


def test_lift_is_in_proportion_to_its_factor():
    def lifted(lift):
        return advanced(START, U, np.array([1.0, lift]))[5]

    low, middle, high = lifted(0.9), lifted(1.0), lifted(1.1)
    assert low > middle > high
    assert low - middle == pytest.approx(middle - high, rel=0.05)


def test_nothing_is_left_of_the_copied_aircraft(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    Simulator(60)
    assert not list(tmp_path.iterdir())


def test_in_still_air_the_model_follows_a_flight(monkeypatch):
    monkeypatch.setattr(f15_mission, "TURBULENCE", 0.0)
    flight = f15_mission.flown(60, 30, jax.random.key(0))
    factors = np.stack([flight.stabilator, np.ones(60)], axis=1)
    each = [advanced(*row) for row in zip(flight.state[:-1], map(Input, *flight.u), factors)]
    off = np.abs(each - flight.state[1:])
    assert (off < f15.PROCESS_STD).all()
    assert (off.mean(0) < f15.PROCESS_STD / 10).all()
    # Without the failure in the model it does not.
    wrong = advanced(flight.state[40], jax.tree.map(lambda a: a[40], flight.u), WHOLE) - flight.state[41]
    assert abs(wrong[10]) > 3 * f15.PROCESS_STD[10]


def test_gusts_are_as_strong_and_as_long_as_said():
    blown = f15_mission.gusts(20_000, jax.random.key(0)).reshape(-1, 3)[1000:]
    # 2000 s hold some 370 independent values of each component: the rms is known to 4 %.
    assert (np.abs(blown.std(0) / f15_mission.TURBULENCE - 1) < 0.16).all()
    lag = round(f15.MEMORY * f15_mission.RATE)
    alike = (blown[lag:] * blown[:-lag]).mean(0) / blown.var(0)
    np.testing.assert_allclose(alike, np.exp(-1), atol=0.2)
