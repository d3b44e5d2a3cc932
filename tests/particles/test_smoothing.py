"""Backward simulation and genealogy on a linear model: the Kalman smoothers."""

import jax.numpy as jnp
import numpy as np
import pytest
from particles.scalar_case import MODEL, Y

import sigmapoint as sp

EXACT = sp.smooth(MODEL, Y)


@pytest.mark.parametrize("method", [sp.bootstrap(4000), sp.upf(2000)], ids=["bootstrap", "upf"])
def test_backward_simulation_is_the_kalman_smoother(method):
    post = sp.smooth(MODEL, Y, method=method, smoother=sp.backward_simulation(4000), key=0)
    np.testing.assert_allclose(post.mean, EXACT.mean, atol=0.06)  # 5 / sqrt(4000), of a standard deviation of 0.6
    np.testing.assert_allclose(post.std, EXACT.std, rtol=0.07)
    filtered = sp.filter(MODEL, Y, method=method, key=0)
    np.testing.assert_allclose(post.log_likelihood, filtered.log_likelihood, rtol=1e-6)  # draws are of 32 bits


def test_trajectories_move_as_the_states_do():
    x = np.asarray(sp.trajectories(MODEL, Y, method=sp.bootstrap(4000), key=0, draws=4000))
    gauss = np.asarray(sp.trajectories(MODEL, Y, key=0, draws=4000))
    assert x.shape == gauss.shape == (4000, 6, 1)
    np.testing.assert_allclose(x.mean(0), EXACT.mean, atol=0.06)
    np.testing.assert_allclose(np.cov(x[..., 0].T), np.cov(gauss[..., 0].T), atol=0.05)


@pytest.mark.parametrize(
    "method", [sp.bootstrap(50_000), sp.auxiliary(sp.ekpf(20_000))], ids=["bootstrap", "auxiliary"]
)
def test_ancestors_of_a_few_instants_are_the_fixed_lag_smoother(method):
    for lag in (0, 2):
        exact = sp.smooth(MODEL, Y, smoother=sp.fixed_lag(lag))
        post = sp.smooth(MODEL, Y, method=method, smoother=sp.fixed_lag(lag), key=0)
        np.testing.assert_allclose(post.mean, exact.mean, atol=0.04)
        np.testing.assert_allclose(post.std, exact.std, rtol=0.06)


def test_no_lag_is_the_filter():
    post = sp.smooth(MODEL, Y, method=sp.bootstrap(100), smoother=sp.fixed_lag(0), key=0)
    np.testing.assert_allclose(
        post.mean, sp.filter(MODEL, Y, method=sp.bootstrap(100), key=0).mean, rtol=1e-6
    )  # draws are of 32 bits


def test_many_trajectories_are_weighed_in_parts():
    """More pairs than are handled at once; the answer does not know of it."""
    post = sp.smooth(MODEL, Y, method=sp.bootstrap(3000), smoother=sp.backward_simulation(700), key=0)
    assert jnp.abs(post.mean - EXACT.mean).max() < 0.15
