"""Every scheme is unbiased; systematic and residual resampling stray less than independent draws."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sigmapoint as sp

SCHEMES = {name: getattr(sp.resampling, name) for name in ("multinomial", "residual", "stratified", "systematic")}
WEIGHTS = np.array([0.0, 0.31, 0.02, 0.17, 0.0, 0.125, 0.125, 0.25, 0.0])
RUNS = 4000


def counts(name, dtype=jnp.float64, shift=0.0):
    log_weights = jnp.log(jnp.asarray(WEIGHTS, dtype)) + jnp.asarray(shift, dtype)
    ancestors = jax.vmap(lambda key: SCHEMES[name](key, log_weights))(jax.random.split(jax.random.key(0), RUNS))
    assert (np.diff(np.asarray(ancestors), axis=1) >= 0).all()
    return np.stack([np.bincount(row, minlength=len(WEIGHTS)) for row in np.asarray(ancestors)])


@pytest.mark.parametrize("name", SCHEMES)
def test_copies_are_in_proportion_to_the_weights(name):
    N = len(WEIGHTS)
    found = counts(name)
    # At most the standard error of independent draws.
    error = np.sqrt(N * WEIGHTS * (1 - WEIGHTS) / RUNS)
    assert (np.abs(found.mean(0) - N * WEIGHTS) <= 4 * error + 1e-12).all()
    assert (found[:, WEIGHTS == 0] == 0).all()


def test_all_schemes_stray_less_than_independent_draws():
    spread = {name: counts(name).var(0).sum() for name in SCHEMES}
    assert spread["systematic"] < 0.5 * spread["multinomial"]
    assert spread["residual"] < 0.8 * spread["multinomial"]
    assert spread["stratified"] < 0.8 * spread["multinomial"]


@pytest.mark.parametrize("name", ["residual", "systematic"])
def test_copies_are_no_fewer_than_the_whole_part(name):
    assert (counts(name) >= np.floor(len(WEIGHTS) * WEIGHTS - 1e-9)).all()


@pytest.mark.parametrize("name", SCHEMES)
def test_weights_need_not_be_normalised_nor_above_the_smallest_number(name):
    np.testing.assert_array_equal(counts(name), counts(name, shift=-50_000.0))


@pytest.mark.parametrize("name", SCHEMES)
def test_no_weight_no_copy_in_32_bits(name):
    N = 5000
    log_weights = jnp.where(jnp.arange(N) % 3 == 1, jax.random.normal(jax.random.key(1), (N,), jnp.float32), -jnp.inf)
    ancestors = np.asarray(SCHEMES[name](jax.random.key(2), log_weights))
    assert (ancestors % 3 == 1).all()


@pytest.mark.parametrize("name", SCHEMES)
def test_equal_weights_and_one_particle(name):
    assert SCHEMES[name](jax.random.key(0), jnp.zeros(1)).tolist() == [0]
    even = np.asarray(SCHEMES[name](jax.random.key(0), jnp.zeros(64)))
    assert even.shape == (64,)
    if name in ("residual", "systematic"):
        np.testing.assert_array_equal(even, np.arange(64))
        for N in (49, 98, 103):  # of which the N-th part, N times, is less than one by round-off
            one_each = np.asarray(SCHEMES[name](jax.random.key(0), jnp.full(N, -jnp.log(float(N)))))
            np.testing.assert_array_equal(one_each, np.arange(N))
