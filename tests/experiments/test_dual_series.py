"""Series and networks from noise: what an epoch is, and that quick runs come below the noise."""

import json

import jax
import jax.numpy as jnp
import numpy as np

import sigmapoint as sp
from sigmapoint.experiments import EXPERIMENTS
from sigmapoint.experiments.dual import dual_ar
from sigmapoint.experiments.dual import runs as dual_series_runs
from sigmapoint.problems import noisy_series


def first_of_two(samples):
    return jax.tree.map(lambda a: a[0], dual_ar.series(2, samples, jax.random.key(3)))


def test_epochs_of_weights_that_are_known_are_those_of_the_plain_filter(monkeypatch):
    monkeypatch.setattr(dual_series_runs, "PRIOR_STD", 1e-9)
    monkeypatch.setattr(dual_series_runs, "ANNEALED", sp.fixed(0.0))
    one = first_of_two(40)
    # Points as far out with as without the weights, which those of an unscented filter are not.
    method = sp.srcdkf()
    plain = sp.filter(dual_series_runs.build(one)(one.start), one.noisy[:, None], method=method).mean[:, 0]
    for estimate in (dual_series_runs.joint(method, 0.0), dual_series_runs.dual(method)):
        for found in estimate(one, 2):
            np.testing.assert_allclose(found, plain, atol=1e-5 * float(jnp.abs(plain).max()))


def test_a_joint_epoch_begins_with_the_belief_at_the_end_of_the_one_before():
    one = first_of_two(60)
    method = sp.srukf()
    twice = dual_series_runs.joint(method)(one, 2)
    build, unknown = dual_series_runs.build(one), dual_series_runs.unknown(one)
    model = sp.joint(build, unknown, dual_series_runs.FIXED)
    post = sp.filter(model, one.noisy[:, None], method=method)
    np.testing.assert_allclose(twice[0], post.mean[:, 0], rtol=1e-8, atol=1e-10)
    n = 5
    drift = dual_series_runs.FIXED * jnp.eye(model.initial.mean.shape[0] - n)
    mean, cov = jnp.asarray(post.mean[-1])[n:], jnp.asarray(post.cov[-1])[n:, n:] + drift
    prior = sp.Gaussian(
        jnp.concatenate([jnp.zeros(n), mean]), jax.scipy.linalg.block_diag(jnp.eye(n), (cov + cov.T) / 2)
    )
    again = sp.StateSpaceModel(model.dynamics, model.observation, model.process_noise, model.observation_noise, prior)
    np.testing.assert_allclose(
        twice[1], sp.filter(again, one.noisy[:, None], method=method).mean[:, 0], rtol=1e-6, atol=1e-8
    )


def test_the_rescaled_network_makes_the_normalised_series():
    key = jax.random.key(1)
    weights = noisy_series.weights_of(key)
    x, mean, std = jnp.arange(5.0) / 5, 0.3, 2.0
    normal = noisy_series.rescaled(weights, jnp.asarray(mean), jnp.asarray(std))
    expected = (noisy_series.Forward(weights)(x, None) - mean) / std
    np.testing.assert_allclose(noisy_series.Forward(normal)((x - mean) / std, None), expected, rtol=1e-5, atol=1e-6)


def test_quick(tmp_path):
    rows = EXPERIMENTS["dual-ar"].run(None, 0, tmp_path, True)
    assert rows == json.loads((tmp_path / "results.json").read_text())
    assert all((tmp_path / f"dual-ar-{name}.png").exists() for name in ("curves", "estimate"))
    measured = {row["method"]: row["measured"] for row in rows if row["quantity"] == "normalised MSE, last epoch"}
    assert measured["dual SR-UKF"] < 0.4 < dual_series_runs.NOISE
    assert measured["joint SR-UKF"] < 0.4
