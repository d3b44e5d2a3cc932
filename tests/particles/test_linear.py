"""On a linear Gaussian model every particle filter converges to the Kalman filter, and its likelihood is unbiased."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from particles.scalar_case import EXACT, MODEL, Y, makes, some

import sigmapoint as sp

FEW, MANY = 64, 1024
RUNS = {FEW: 600, MANY: 100}


def runs(method, count):
    keys = jax.random.split(jax.random.key(0), count)
    return jax.vmap(lambda key: sp.filter(MODEL, Y, method=method, key=key, keep=("mean", "std")))(keys)


SLOW = (
    "ekpf",
    "carried, its own noise",
    "fully adapted",
    "auxiliary upf",
    "moved upf",
    "Rao-Blackwellised",
    "auxiliary",
    "moved",
)


@pytest.mark.parametrize("name", some(makes(1), SLOW))
def test_convergence_to_the_kalman_filter_is_of_order_one_half(name):
    error = {}
    for N, count in RUNS.items():
        post = runs(makes(N)[name], count)
        error[N] = np.sqrt(np.mean((np.asarray(post.mean) - np.asarray(EXACT.mean)) ** 2 / np.asarray(EXACT.std) ** 2))
        if N == FEW:
            ratio = np.exp(np.asarray(post.log_likelihood) - float(EXACT.log_likelihood))
            # A move aims at a posterior that few particles stand for: all but unbiased.
            assert abs(ratio.mean() - 1) < 3 * ratio.std() / np.sqrt(count)
    slope = np.log(error[MANY] / error[FEW]) / np.log(MANY / FEW)
    # Either error is known to 5 %, so the slope to 0.026.
    assert abs(slope + 0.5) < 0.1
    assert error[MANY] < 3 / np.sqrt(MANY)
    np.testing.assert_allclose(np.asarray(post.std).mean(0), EXACT.std, rtol=0.02)


def test_better_proposals_leave_more_even_weights():
    some = ("bootstrap", "upf", "guided", "fully adapted")
    ess = {name: float(jnp.mean(runs(makes(200)[name], 20).ess)) for name in some}
    assert ess["bootstrap"] < ess["upf"]
    assert ess["bootstrap"] < ess["guided"]
    np.testing.assert_allclose(ess["fully adapted"], 200, rtol=1e-6)


def test_innovations_are_those_of_the_kalman_filter():
    post = sp.filter(MODEL, Y, method=sp.bootstrap(50_000), key=0)
    np.testing.assert_allclose(post.innovation, EXACT.innovation, atol=0.03)
    np.testing.assert_allclose(post.innovation_cov, EXACT.innovation_cov, rtol=0.05)
    np.testing.assert_allclose(post.nis, EXACT.nis, atol=0.15)
    np.testing.assert_allclose(post.cov[:, 0, 0], EXACT.cov[:, 0, 0], rtol=0.05)
    np.testing.assert_allclose(post.std, np.sqrt(np.asarray(post.cov)[:, 0]), rtol=1e-9)


def test_several_states_and_sensors_some_of_them_missing():
    R = jnp.array([[0.3, 0.1], [0.1, 0.2]])
    model = sp.StateSpaceModel(
        lambda x, u: jnp.stack([x[0] + 0.5 * x[1], 0.9 * x[1]]) + u,
        lambda x, u: jnp.stack([x[0], x[0] + x[1]]),
        jnp.array([[0.2, 0.05], [0.05, 0.1]]),
        R,
        sp.Gaussian(jnp.zeros(2), jnp.eye(2)),
    )
    y = np.array([[1.0, 0.5], [np.nan, 1.5], [2.0, np.nan], [np.nan, np.nan], [1.0, 1.0]])
    u = 0.1 * np.ones((5, 2))
    exact = sp.filter(model, y, u)
    for method in (sp.bootstrap(50_000), sp.auxiliary(sp.upf(20_000))):
        post = sp.filter(model, y, u, method, key=0)
        np.testing.assert_allclose(post.mean, exact.mean, atol=0.03)
        np.testing.assert_allclose(post.cov, exact.cov, atol=0.02)
        np.testing.assert_allclose(post.log_likelihood, exact.log_likelihood, atol=0.06)
        np.testing.assert_array_equal(np.isnan(post.innovation), np.isnan(y))
