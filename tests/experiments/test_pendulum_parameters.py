"""The pendulum's parameters: what its falls can say, and that a quick run finds it."""

import json

import jax
import numpy as np

from sigmapoint.experiments import EXPERIMENTS
from sigmapoint.experiments.pendulum_parameters import experiment
from sigmapoint.experiments.pendulum_parameters.learning import Learned, prediction
from sigmapoint.problems.pendulum import TRUTH
from sigmapoint.problems.pendulum_falls import ANGLE, drawn


def test_falls_begin_near_upright_and_are_predicted_until_a_rod_passes_the_horizontal():
    before, after, there = map(np.asarray, drawn(50, 10.0, 0.0, jax.random.key(0)))
    assert (np.abs(before[:, 0, [2, 4]]) <= ANGLE).all()
    assert (np.ptp(before[:, :, 6], axis=1) == 0).all()
    assert (np.abs(before[there][:, [2, 4]]) <= np.pi / 2).all()
    assert 10 < there.sum(1).mean() < 50
    predicted = jax.jit(jax.vmap(prediction(experiment.WAYS["UKF"].decoded), (None, 0)))
    np.testing.assert_allclose(predicted(np.array(TRUTH) - 1, before[there]), after[there], rtol=1e-12, atol=1e-12)


def test_errors_without_the_common_factor_do_not_see_it():
    w = np.tile(TRUTH, (2, 3, 1)) * np.array([1, 1, 0.9, 0.9, 0.9])
    one = Learned(np.zeros((2, 3)), w)
    np.testing.assert_allclose(one.factor, 0.9)
    np.testing.assert_allclose(one.worst, 10.0)
    np.testing.assert_allclose(one.worst_visible, 0.0, atol=1e-12)


def test_a_quick_run_finds_what_can_be_seen_and_is_written(tmp_path):
    rows = EXPERIMENTS["pendulum-parameters"].run(None, 0, tmp_path, True)
    assert json.loads((tmp_path / "results.json").read_text()) == rows
    assert (tmp_path / "estimates.png").exists()
    measured = {(row["quantity"], row["method"]): row["measured"] for row in rows}
    for name in experiment.QUICK_WAYS:
        for case in experiment.FORCES:
            assert measured[f"largest error without the common factor of the masses, %, {case}", name] < 10
        assert measured[f"largest error of the five, %, {experiment.PUSHED}", name] < 10
