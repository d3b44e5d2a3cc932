"""Terrain-aided navigation: ridges are alike where flights begin, and then differ, as the module says."""

import jax.numpy as jnp
import numpy as np

from sigmapoint.problems import terrain

ALONG = jnp.linspace(-10_000.0, 20_000.0, 3001)
ROUNDED = 1e-3  # m: amplitudes are written with four decimals at most


def test_ridges_differ_as_the_formula_says():
    apart = terrain.height(ALONG + terrain.RIDGE) - terrain.height(ALONG)
    np.testing.assert_allclose(apart, terrain.difference(ALONG), atol=ROUNDED)


def test_ridges_look_alike_at_first_and_not_at_last():
    early, late = jnp.linspace(-4600.0, 4600.0, 200), jnp.linspace(9000.0, 14_000.0, 200)
    assert float(jnp.abs(terrain.difference(early)).max()) < 1 < terrain.HEIGHT_STD
    assert float(terrain.difference(late).min()) > 2 * terrain.HEIGHT_STD


def test_the_height_at_the_start_is_met_at_several_places_within_the_prior():
    within = ALONG[jnp.abs(ALONG) < 2 * terrain.START_STD[0]]
    for start in (-1500.0, 0.0, 1500.0):
        above = np.asarray(terrain.height(within) > terrain.height(jnp.array(start)))
        assert (above[1:] != above[:-1]).sum() >= 4


def test_the_height_is_smooth_enough_to_be_followed():
    slope = np.gradient(np.asarray(terrain.height(ALONG)), np.asarray(ALONG))
    assert np.abs(slope).max() < 0.5


def test_ridges_are_told_apart_after_a_minute_and_not_before():
    along = terrain.SPEED * terrain.STEP * jnp.arange(float(terrain.STEPS))
    ahead = np.cumsum(np.asarray(terrain.difference(along)) ** 2) / (2 * terrain.HEIGHT_STD**2)  # as expected
    assert ahead[60] < np.log(20)
    assert ahead[100] > np.log(1e6)
