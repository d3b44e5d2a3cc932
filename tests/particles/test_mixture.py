"""Mixtures of Gaussians: density, merging, and how they are found in points."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from sigmapoint.particles.gaussian_sum.expectation_maximization import about, fitted
from sigmapoint.particles.gaussian_sum.mixture import Mixture
from sigmapoint.spaces import Euclidean, angles

SPACE = Euclidean()
COVS = np.array([[[1.0, 0.3], [0.3, 0.5]], [[0.2, 0.0], [0.0, 2.0]], [[0.5, -0.2], [-0.2, 0.4]]])
MIXTURE = Mixture(
    jnp.log(jnp.array([0.5, 0.3, 0.2])),
    jnp.array([[0.0, 0.0], [3.0, -1.0], [-2.0, 4.0]]),
    jnp.linalg.cholesky(jnp.asarray(COVS)),
)


def drawn(count, seed=0):
    of = jnp.repeat(jnp.arange(3), jnp.asarray([5, 3, 2]) * count // 10, total_repeat_length=count)
    return MIXTURE.draws(jax.random.key(seed), of, SPACE)


def test_density_is_the_weighted_sum_of_the_components():
    points = drawn(20)
    parts = [multivariate_normal(m, C).pdf(points) for m, C in zip(MIXTURE.mean, COVS)]
    np.testing.assert_allclose(
        MIXTURE.log_density(points, SPACE), np.log([0.5, 0.3, 0.2] @ np.array(parts)), rtol=1e-12
    )


def test_moments_are_those_of_draws():
    points = np.asarray(drawn(200_000))
    cloud = MIXTURE.moments(SPACE)
    std = points.std(0)
    assert (np.abs(points.mean(0) - cloud.mean) < 5 * std / np.sqrt(200_000)).all()
    np.testing.assert_allclose(np.cov(points.T), cloud.cov, atol=0.01 * std.max() ** 2)


@pytest.mark.parametrize("size", [1, 2])
def test_merging_keeps_mean_and_covariance(size):
    whole, fewer = MIXTURE.moments(SPACE), MIXTURE.reduced(size, SPACE)
    assert fewer.size == size
    np.testing.assert_allclose(fewer.moments(SPACE).mean, whole.mean, rtol=1e-12)
    np.testing.assert_allclose(fewer.moments(SPACE).cov, whole.cov, rtol=1e-12)


def test_those_that_are_alike_are_merged_first():
    twins = jax.tree.map(lambda a: jnp.concatenate([a, a[1:2]]), MIXTURE)
    fewer = twins.reduced(3, SPACE)
    np.testing.assert_allclose(np.sort(np.asarray(fewer.mean), 0), np.sort(np.asarray(MIXTURE.mean), 0), rtol=1e-12)
    np.testing.assert_allclose(np.sort(np.exp(fewer.log_weights)), [0.2, 0.5, 0.6], rtol=1e-12)


def test_a_component_of_no_weight_changes_nothing():
    empty = jax.tree.map(lambda a: jnp.concatenate([a, a[:1] + 100.0]), MIXTURE)._replace(
        log_weights=jnp.append(MIXTURE.log_weights, -jnp.inf)
    )
    for size in (3, 2):
        np.testing.assert_allclose(empty.reduced(size, SPACE).moments(SPACE).cov, MIXTURE.moments(SPACE).cov, rtol=1e-9)


def test_expectation_maximisation_finds_the_mixture():
    N = 20_000
    points = drawn(N)
    cloud = np.cov(np.asarray(points).T)
    start = about(jnp.array([[0.5, 0.5], [2.0, 0.0], [-1.0, 3.0]]), jnp.asarray(cloud))
    found = fitted(points, jnp.full(N, -np.log(N)), start, 100, SPACE)
    np.testing.assert_allclose(np.exp(found.log_weights), [0.5, 0.3, 0.2], atol=0.02)
    np.testing.assert_allclose(found.mean, MIXTURE.mean, atol=0.1)
    np.testing.assert_allclose(found.cov, COVS, atol=0.1)
    np.testing.assert_allclose(found.moments(SPACE).mean, points.mean(0), atol=1e-3)


def test_a_weight_is_as_good_as_copies():
    points = drawn(200)
    start = about(points[::80], jnp.eye(2))
    copies = jnp.concatenate([points, points[:100]])
    twice = jnp.where(jnp.arange(200) < 100, 2.0, 1.0) / 300
    one = fitted(points, jnp.log(twice), start, 10, SPACE)
    two = fitted(copies, jnp.full(300, -jnp.log(300.0)), start, 10, SPACE)
    # The prior is as strong as one point, and weighted points count for fewer, 180 against 300: that much of it more.
    prior = (1 / 180 - 1 / 300) * float(jnp.cov(points.T).max())
    np.testing.assert_allclose(one.mean, two.mean, atol=prior)
    np.testing.assert_allclose(one.cov, two.cov, atol=prior / 0.2)  # of a component's weight


def test_one_point_with_all_the_weight_leaves_finite_components():
    points = drawn(50)
    log_weights = jnp.where(jnp.arange(50) == 3, 0.0, -jnp.inf)
    found = fitted(points, log_weights, about(points[:3], jnp.eye(2)), 10, SPACE)
    assert all(np.isfinite(a).all() for a in (found.mean, found.factor))
    np.testing.assert_allclose(found.moments(SPACE).mean, points[3], atol=1e-9)


def test_a_component_of_little_weight_far_from_the_others_keeps_its_width():
    N, share = 400, 0.05
    points = jax.random.normal(jax.random.key(0), (N, 1)) + jnp.repeat(jnp.array([0.0, 1000.0]), N // 2)[:, None]
    log_weights = jnp.log(jnp.repeat(jnp.array([1 - share, share]), N // 2) / (N // 2))
    start = Mixture(jnp.log(jnp.array([0.5, 0.5])), jnp.array([[0.0], [1000.0]]), jnp.ones((2, 1, 1)))
    found = fitted(points, log_weights, start, 10, SPACE)
    np.testing.assert_allclose(found.factor[:, 0, 0], 1.0, rtol=0.2)  # four deviations of a deviation of 200 draws
    np.testing.assert_allclose(jnp.exp(found.log_weights), [1 - share, share], rtol=1e-6)


def test_angles_are_mixed_the_short_way_round():
    mixture = Mixture(jnp.log(jnp.array([0.5, 0.5])), jnp.array([[3.1], [-3.1]]), 0.1 * jnp.ones((2, 1, 1)))
    one = mixture.reduced(1, angles(0))
    assert abs(abs(float(one.mean[0, 0])) - np.pi) < 1e-6
    assert float(one.factor[0, 0, 0]) < 0.15
