"""Noisy series, and what their smoothers are worth."""

import json

import jax
import jax.numpy as jnp
import numpy as np

from sigmapoint.experiments import EXPERIMENTS
from sigmapoint.problems import network, noisy_series


def test_a_step_back_undoes_a_step_where_the_network_does():
    x = jnp.arange(1.0, 5.0)
    forward = noisy_series.Forward(network.started((4, 2, 1), jax.random.key(0)))(x, None)
    np.testing.assert_array_equal(forward[1:], x[:-1])
    back = noisy_series.Backward(network.started((4, 2, 1), jax.random.key(1)))(forward, None)
    np.testing.assert_array_equal(back[:-1], x[:-1])


def test_drawn_networks_are_chaotic_and_bounded():
    for seed in range(3):
        key = jax.random.key(seed)
        assert noisy_series.lyapunov(noisy_series.chaotic(jax.random.split(key)[0])) >= noisy_series.LEAST
        series = noisy_series.drawn(1000, key)
        assert 0.05 < series.std() < 20


def test_the_stationary_distribution_is_that_of_the_lags():
    series = jax.random.normal(jax.random.key(0), (2000,)).cumsum() % 5
    found = noisy_series.stationary(series, 3)
    np.testing.assert_allclose(found.mean, series.mean(), atol=0.02)
    np.testing.assert_allclose(jnp.diagonal(found.cov), series.var(), rtol=0.02)


def test_quick(tmp_path):
    rows = EXPERIMENTS["smoother"].run(None, 0, tmp_path, True)
    assert rows == json.loads((tmp_path / "results.json").read_text())
    assert (tmp_path / "smoother.png").exists()
    found = {(row["method"], row["quantity"][-2]): row["measured"] for row in rows}
    assert found["UKS", "S"] < found["UKS", "F"] < 0.6
