"""Joint estimation of the papers and of a real cell: that quick runs find what they look for."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sigmapoint as sp
from sigmapoint.data import load_leaf
from sigmapoint.experiments import EXPERIMENTS
from sigmapoint.experiments.battery_joint import experiment as battery_joint
from sigmapoint.experiments.modes import experiment as modes
from sigmapoint.experiments.modes.runs import truncated
from sigmapoint.experiments.pendulum_adaptive import experiment as pendulum_adaptive
from sigmapoint.problems import battery_joint as cell
from sigmapoint.problems import masses


@pytest.fixture
def quick(tmp_path):
    """The rows of a quick run by quantity and method, with its files looked at."""

    def run(name, *figures):
        rows = EXPERIMENTS[name].run(None, 0, tmp_path, True)
        assert json.loads((tmp_path / "results.json").read_text()) == rows
        assert all((tmp_path / f"{figure}.png").exists() for figure in figures)
        return {(row["quantity"], row["method"]): row["measured"] for row in rows}

    return run


def test_modes_near_their_start_are_found_except_with_a_truncated_transition(quick):
    measured = quick("modes", "modes-nyquist", "modes-shares")
    share = f"share of runs within 1 % of both, {modes.QUICK_CASES[0].text}"
    assert [measured[share, name] for name in ("EKF", "UKF")] == [1, 1]
    assert measured[share, modes.SHORTER] <= 0.5
    assert measured[f"share of runs within 1 % of both, {modes.FAST.text}", modes.TRUNCATED] == 1


@pytest.mark.parametrize("terms", [1, 2])
def test_a_truncated_transition_is_off_an_exponential_by_the_next_power_of_the_step(terms):
    x, start = jnp.array([0.3, -0.2, 0.5, 0.1, 0.0, 0.1]), masses.Start(jnp.zeros(4), jnp.ones(4))
    theta = sp.positive(jnp.asarray(masses.TRUTH), 0.1 * jnp.asarray(masses.TRUTH))

    def model(dt):
        return sp.joint(lambda omega: masses.model(omega, dt, start), theta)

    def jacobian(model):
        return jax.jacfwd(lambda x: model.dynamics(x, None))(x)

    def off(dt):
        A = (jacobian(truncated(model, jnp.asarray(1.0), 1)) - jnp.eye(6)) * dt
        return jnp.abs(jacobian(truncated(model, jnp.asarray(dt), terms)) - jax.scipy.linalg.expm(A)).max()

    rate = jax.jacfwd(lambda x: (model(1e-6).dynamics(x, None) - x) / 1e-6)(x)
    A = jacobian(truncated(model, jnp.asarray(1.0), 1)) - jnp.eye(6)
    np.testing.assert_allclose(A, rate, atol=1e-4)

    assert 0.95 < off(2e-3) / off(1e-3) / 2 ** (terms + 1) < 1.05


def test_a_pendulum_of_unknown_masses_is_kept_upright(quick):
    measured = quick("pendulum-adaptive", "pendulum-adaptive-run", "pendulum-adaptive-parameters")
    assert measured[f"share of trials that succeed, {pendulum_adaptive.BASE}", "UKF"] > 0.5
    assert measured["error of M [kg] in the end, %", "UKF"] < 10


def test_the_capacity_of_the_cell_is_found_with_an_honest_bar(quick):
    measured = quick("battery-joint", "battery-joint-estimates", "battery-joint-error")
    shown = battery_joint.SHOWN
    assert measured["error of the capacity at the end, % of the counted one, 25 °C", shown] < battery_joint.CLOSE
    assert measured["counted capacity inside the 95 % interval at the end, share of starts, 25 °C", shown] == 1
    assert 0.95 < measured["series resistance over jumps of voltage by current, median over jumps, 25 °C", shown] < 1.05


@pytest.mark.parametrize(("temperature", "expected"), [(10, 2.63), (25, 1.60), (40, 1.56)])
def test_jumps_of_the_voltage_show_the_series_resistance(temperature, expected):
    log = load_leaf(temperature)
    rows, seen = cell.jumps(log)
    assert (np.abs(log.current[rows] - log.current[rows - 1]) > cell.JUMP).all()
    np.testing.assert_allclose(1e3 * np.median(seen), expected, rtol=0.01)
