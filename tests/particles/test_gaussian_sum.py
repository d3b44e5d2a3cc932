"""Gaussian-sum filters: the Kalman filter where there is one, both modes where there are two, mixtures as noises."""

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
import pytest
from particles.scalar_case import EXACT, MODEL, Y, some, sums

import sigmapoint as sp

MAKES = {name: lambda N, name=name: sums(N)[name] for name in sums(10)}
SIZES = {64: 200, 1024: 50}


@pytest.mark.parametrize("name", some(MAKES, ["gspf"]))
def test_convergence_to_the_kalman_filter_is_of_order_one_half(name):
    error = []
    for N, count in SIZES.items():
        keys = jax.random.split(jax.random.key(0), count)
        method = MAKES[name](N)
        post = jax.vmap(lambda key, method=method: sp.filter(MODEL, Y, method=method, key=key))(keys)
        off = (np.asarray(post.mean) - np.asarray(EXACT.mean)) / np.asarray(EXACT.std)
        error.append(np.sqrt(np.mean(off**2)))
        # Consistent: as far off as the mixture is, which is found in a sample.
        assert abs(np.exp(np.asarray(post.log_likelihood) - float(EXACT.log_likelihood)).mean() - 1) < 2 / np.sqrt(N)
        np.testing.assert_allclose(np.asarray(post.innovation).mean(0), EXACT.innovation, atol=4 / np.sqrt(N * count))
    slope = np.log(error[1] / error[0]) / np.log(16)
    assert abs(slope + 0.5) < 0.12  # either error is known to 8 %
    np.testing.assert_allclose(np.asarray(post.std).mean(0), EXACT.std, rtol=0.02)
    np.testing.assert_allclose(np.asarray(post.innovation_cov).mean(0), EXACT.innovation_cov, rtol=0.03)


@pytest.mark.parametrize("name", some(MAKES, ["gspf"]))
def test_the_mixtures_of_a_series_are_kept_and_tabled(name):
    post = sp.filter(MODEL, Y, method=MAKES[name](300), key=0, keep=("mean", "cov", "mixture"))
    mixture, G = post.mixture, len(post.mixture.log_weights[0])
    assert (mixture.mean.shape, mixture.cov.shape) == ((6, G, 1), (6, G, 1, 1))
    moments = jax.vmap(lambda m: m.moments(MODEL.state_space))(mixture)
    np.testing.assert_allclose(moments.mean, post.mean, rtol=1e-12)
    np.testing.assert_allclose(moments.cov, post.cov, rtol=1e-12)
    grid = np.linspace(-8, 8, 2001)
    densities = jax.vmap(lambda m: jnp.exp(m.log_density(grid[:, None])))(mixture)
    np.testing.assert_allclose(np.trapezoid(densities, grid), 1, atol=1e-6)
    table = post.to_xarray()
    assert dict(table["mixture.mean"].sizes) == {"time": 6, "component": G, "state": 1}
    np.testing.assert_array_equal(table["mixture.cov"], mixture.cov)


TWO = dist.MixtureSameFamily(
    dist.Categorical(jnp.array([0.6, 0.4])), dist.Normal(jnp.array([-1.0, 2.0]), jnp.array([0.3, 0.5]))
)


@pytest.mark.parametrize("name", some(MAKES, ["gmsppf"]))
@pytest.mark.parametrize("part", ["process_noise", "observation_noise"])
def test_a_mixture_as_noise_is_taken_component_by_component(name, part):
    """Against particles, of which there are many."""
    noises = {"process_noise": 0.5 * jnp.eye(1), "observation_noise": 0.25 * jnp.eye(1)} | {part: TWO}
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, initial=MODEL.initial, **noises)
        exact = sp.filter(model, Y, method=sp.bootstrap(100_000), key=1)
        method = sp.gspf(8000, 8) if name == "gspf" else sp.gmsppf(8000, 8)
        post = sp.filter(model, Y, method=method, key=0)
    assert (np.abs(np.asarray(post.mean - exact.mean)) < 0.1 * np.asarray(exact.std)).all()
    np.testing.assert_allclose(post.std, exact.std, rtol=0.1)
    np.testing.assert_allclose(post.log_likelihood, exact.log_likelihood, atol=0.15)


def test_saved_and_loaded_goes_on_as_before(tmp_path):
    live = sp.online(MODEL, sp.gmsppf(50, 2))
    state = live.predict(live.update(live.init(key=1), [1.0])[0])
    sp.save(tmp_path / "state.npz", state)
    resumed = sp.load(tmp_path / "state.npz", like=live.init(key=2))
    np.testing.assert_array_equal(live.update(resumed, [0.5])[0].mean, live.update(state, [0.5])[0].mean)


def test_a_batch_keeps_mixtures():
    series = [np.asarray(Y[:3]), np.asarray(Y)]
    how = {"method": sp.gmsppf(50, 2), "key": 0, "keep": ("mixture", "ess", "log_likelihood")}
    assert [post.mixture.mean.shape for post in sp.batch(MODEL, series, **how)] == [(3, 2, 1), (6, 2, 1)]
    together = sp.batch(MODEL, np.stack([Y, Y]), **how)
    assert (together.mixture.cov.shape, together.ess.shape) == ((2, 6, 2, 1, 1), (2, 6))
