"""The gamma-driven autoregression: its noise is a gamma distribution, and its sensors can be inverted."""

import jax
import jax.numpy as jnp
import numpy as np
import scipy.stats

from sigmapoint.problems import gamma_autoregression as problem

EXACT = scipy.stats.gamma(3.0, scale=0.5)


def test_the_noise_is_a_gamma_distribution():
    w = jnp.array([0.01, 0.5, 1.5, 7.0])
    np.testing.assert_allclose(problem.NOISE.log_prob(w), EXACT.logpdf(w), rtol=1e-12)
    assert problem.NOISE.support(jnp.array([-1.0, 0.0, 1.0])).tolist() == [False, False, True]
    assert (problem.NOISE.mean, problem.NOISE.variance) == (EXACT.mean(), EXACT.var())
    drawn = problem.NOISE.sample(jax.random.key(0), (10_000,))
    assert scipy.stats.kstest(np.asarray(drawn), EXACT.cdf).pvalue > 0.01


def test_a_series_is_of_the_printed_equations():
    x, y = (np.asarray(a)[:, 0] for a in problem.drawn(jax.random.key(0)))
    t = np.arange(61)
    w = x[1:] - (1 + np.sin(0.04 * np.pi * t[:-1]) + 0.5 * x[:-1])
    assert (w > 0).all()
    assert abs(w.mean() - 1.5) < 4 * np.sqrt(0.75 / 60)
    noise = (y - np.where(t <= 30, 0.2 * x**2, 0.5 * x - 2))[1:] / np.sqrt(1e-5)
    assert abs(noise).max() < 4
    assert 0.7 < noise.std() < 1.3
    assert x[0] == 1
    assert np.isnan(y[0])


def test_the_sensor_inverted_is_off_by_its_noise_over_its_slope():
    x, y = jax.vmap(problem.drawn)(jax.random.split(jax.random.key(1), 50))
    x, off = np.asarray(x)[:, 1:, 0], np.asarray(problem.inverted(y) - x)[:, 1:, 0]
    slope = np.where(np.arange(1, 61) <= 30, 0.4 * x, 0.5)
    # To first order; the second is of a relative size of 1e-2.
    np.testing.assert_allclose(np.std(off * slope), np.sqrt(1e-5), rtol=0.06)
