"""The robot arm: its formula, and that every method learns it."""

import json
import os
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sigmapoint.experiments import EXPERIMENTS
from sigmapoint.experiments.learning import robot_arm as experiment
from sigmapoint.problems import robot_arm

MACKAY = os.environ.get("SIGMAPOINT_MACKAY", "")


def test_the_hand_is_where_geometry_says():
    straight = robot_arm.hand(jnp.array([[0.0, 0.0], [np.pi / 2, 0.0], [0.0, np.pi / 2]]))
    np.testing.assert_allclose(straight, [[3.3, 0.0], [0.0, 3.3], [2.0, 1.3]], atol=1e-12)


def test_data_are_in_range_with_the_noise_they_say():
    x, y = robot_arm.drawn(20_000, jax.random.key(0))
    assert (jnp.abs(x[:, 0]) >= 0.453).all()
    assert (jnp.abs(x[:, 0]) <= 1.932).all()
    assert ((x[:, 1] >= 0.534) & (x[:, 1] <= 3.142)).all()
    residual = y - robot_arm.hand(x)
    np.testing.assert_allclose(residual.std(0), 0.05, rtol=4 / (2 * 20_000) ** 0.5)
    np.testing.assert_allclose(residual.mean(0), 0.0, atol=4 * 0.05 / 20_000**0.5)


@pytest.mark.skipif(not MACKAY, reason="SIGMAPOINT_MACKAY does not name a folder with MacKay's own rows")
def test_mackays_rows_are_of_this_formula():
    x, y = robot_arm.mackays(Path(MACKAY))
    assert x.shape == y.shape == (600, 2)
    np.testing.assert_allclose((y - robot_arm.hand(jnp.asarray(x))).std(0), 0.05, rtol=0.1)


def test_a_quick_run_learns_and_is_written(tmp_path):
    rows = EXPERIMENTS["robot-arm"].run(None, 0, tmp_path, True)
    assert json.loads((tmp_path / "results.json").read_text()) == rows
    assert (tmp_path / "robot-arm-forgetting.png").exists()
    assert (tmp_path / "robot-arm-annealed.png").exists()
    measured = {(row["quantity"], row["method"]): row["measured"] for row in rows}
    for name in experiment.METHODS:
        assert measured["forgetting: test MSE per output after the last epoch", name] < (
            0.3 if "wide" in name else 0.03
        )
    for _, root in experiment.PAIRS:
        assert measured["largest difference between dense and square root, relative, first epoch", root] < 1e-6
