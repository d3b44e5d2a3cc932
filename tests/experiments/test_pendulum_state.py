"""A pendulum of which half the states are seen: levels of noise, what becomes of trials, the limit, and the film."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.animation import FuncAnimation
from matplotlib.figure import Figure

import sigmapoint as sp
from sigmapoint.experiments import EXPERIMENTS
from sigmapoint.experiments.pendulum_state.experiment import _sign, telling
from sigmapoint.experiments.pendulum_state.figures import joints
from sigmapoint.experiments.pendulum_state.limit import least_angle
from sigmapoint.experiments.pendulum_state.runs import by_ranks, outcome, p_value
from sigmapoint.experiments.publishing.results import Film, Mean
from sigmapoint.problems import pendulum, pendulum_state
from sigmapoint.problems.pendulum_state import Trial


def trials(angles, estimates):
    """Two steps of one trial each: the upper rod at these angles, and as estimated."""
    state, mean = (np.zeros((len(angles), 2, 6)) for _ in range(2))
    state[:, 1, 4], mean[:, 1, 4] = angles, estimates
    return Trial(state, mean, np.zeros((len(angles), 2)))


def test_ten_decibels_are_a_tenth_of_the_power():
    state = np.random.default_rng(0).normal(size=(3, 50, 6)) * np.arange(1.0, 7.0)
    power = pendulum_state.sensors(state, 10.0) ** 2
    np.testing.assert_allclose(power, (state[..., :3] ** 2).reshape(-1, 3).mean(0) / 10, rtol=1e-12)


def test_a_pendulum_seen_by_good_sensors_is_held_by_the_estimate_and_by_the_truth():
    truth, start = pendulum_state.truth(), pendulum_state.starts(2, jax.random.key(0))[0]
    noise = jax.tree.map(lambda a: a[0], pendulum_state.noise(1, 150, jax.random.key(1)))

    @jax.jit
    def both(sensors):
        known = pendulum_state.held(start, noise)
        return known, pendulum_state.trusted(sp.ekf(), truth, sensors, start, noise)

    sensors = jnp.array([0.01, 0.01, 0.001])
    for trial in both(sensors):
        assert not pendulum.fallen(trial.state).any()
        assert (np.abs(trial.state[-1, [2, 4]]) < 0.2).all()
    np.testing.assert_allclose(trial.mean[-1, :3], trial.state[-1, :3], atol=5 * float(sensors.max()))


def test_a_turn_off_is_no_error_and_a_rod_below_the_horizontal_is_a_crash():
    seen = trials([0.1, 0.1, 2.0], [0.1 + 2 * np.pi, 0.3, np.nan])
    found = outcome(seen, seen)
    np.testing.assert_allclose(found.error[:2, 1], [0.0, 0.2 / np.sqrt(2)], atol=1e-12)
    assert np.isnan(found.error[2, 1])
    assert found.fell.tolist() == [False, False, True]
    assert found.lost.tolist() == [False, False, True]  # no estimate is none
    np.testing.assert_array_equal(found.when, [np.nan, np.nan, pendulum.STEP])


def test_a_rod_that_comes_back_up_has_crashed():
    fallen = trials([0.0], [0.0])
    fallen.state[0, 0, 4] = 2.0
    assert outcome(fallen, fallen).fell.tolist() == [True]


def test_the_film_is_of_the_level_that_tells_filters_apart():
    up, down = trials([0.0, 0.0], [0.0, 0.0]), trials([0.0, 2.0], [0.0, 0.0])
    good, bad = outcome(up, up), outcome(down, down)
    assert telling({10.0: {"EKF": bad, "UKF": bad}, 20.0: {"EKF": bad, "UKF": good}}) == (20.0, 1)


def test_a_difference_is_named_by_its_sign_and_only_where_it_is_sure():
    assert _sign(Mean(-1.0, 0.1, 9), 0.001) == "UKF better"
    assert _sign(Mean(1.0, 0.1, 9), 0.001) == "EKF better"
    assert _sign(Mean(-1.0, 0.9, 9), 0.3) == "no difference shown"


def test_one_large_difference_decides_a_mean_and_not_a_median():
    differences = np.random.default_rng(1).normal(0.5, 1.0, 60)
    assert max(p_value(differences), by_ranks(differences)) < 0.01
    assert p_value(np.append(differences, -1000.0)) > 0.1
    assert by_ranks(np.append(differences, -1000.0)) < 0.01


def test_trials_without_an_estimate_are_left_out_of_p_values():
    differences = np.random.default_rng(2).normal(0.5, 1.0, 20)
    for p in (p_value, by_ranks):
        assert p(np.append(differences, np.nan)) == p(differences)
        assert np.isnan(p(np.full(3, np.nan)))
        assert np.isnan(p(np.zeros(3)))


def test_the_limit_is_proportional_to_the_noise_where_nothing_disturbs():
    few, many = (least_angle(times * np.array([1.0, 1.0, 0.1])) for times in (1.0, 4.0))
    np.testing.assert_allclose(many, 4 * few, rtol=0.01)  # the disturbance is a hundredth of the noise and less


def test_rods_hang_together_on_the_cart():
    cart, joint, top = joints(np.array([0.5, 0.0, 0.3, 0.0, -0.2, 0.0])).T
    np.testing.assert_allclose(cart, [0.5, 0.0])
    np.testing.assert_allclose(np.linalg.norm(joint - cart), 2 * pendulum.TRUTH.l1)
    np.testing.assert_allclose(np.linalg.norm(top - joint), 2 * pendulum.TRUTH.l2)
    assert joint[0] < cart[0] < top[0] + 2 * pendulum.TRUTH.l2  # a positive angle leans to the left


def test_a_film_is_a_moving_picture_in_the_folder_and_on_the_page(tmp_path):
    figure = Figure(figsize=(1, 1))
    (line,) = figure.subplots().plot([0], [0])
    moving = FuncAnimation(figure, lambda k: line.set_data([0, k], [0, 1]) or [line], 3, init_func=list)
    image = Film("film", "Moves.", moving, 10).saved(tmp_path)
    assert image.file == "film.gif"
    assert image.content[:6] == b"GIF89a"
    assert (tmp_path / "film.gif").read_bytes() == image.content


@pytest.mark.slow
def test_a_quick_run_loses_the_pendulum_in_much_noise_and_holds_it_in_little(tmp_path):
    rows = EXPERIMENTS["pendulum-state"].run(None, 0, tmp_path, True)
    assert json.loads((tmp_path / "results.json").read_text()) == rows
    assert (tmp_path / "pendulum-state-film.gif").stat().st_size < 1.5e6
    measured = {(row["quantity"], row["method"]): row["measured"] for row in rows}
    for name in ("EKF", "UKF"):
        assert measured["the same, control by the estimate, 30 dB", name] < 0.1
        assert measured["the same, control by the estimate, 10 dB", name] > 0.5
