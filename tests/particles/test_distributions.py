"""Noises given as distributions: moments for Gaussian filters, densities for particle filters, draws for both."""

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
import pytest
from particles.scalar_case import MODEL, Y

import sigmapoint as sp
from sigmapoint.distributions import Given, moments


@pytest.fixture(autouse=True)
def _as_users_have_it():
    """numpyro counts on shapes and types being promoted."""
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        yield


A = jnp.array([[1.0, 0.3], [0.3, 0.5]])
PAIR = dist.MultivariateNormal(jnp.array([[-2.0, 1.0], [1.0, 0.0]]), jnp.stack([A, 0.1 * jnp.eye(2)]))
HALF = dist.Categorical(jnp.array([0.25, 0.75]))
GIVEN = {
    "scalar": dist.Normal(0.3, 2.0),
    "vector": dist.Normal(jnp.array([1.0, -1.0]), jnp.array([0.5, 2.0])),
    "vector as event": dist.Normal(jnp.zeros(2), jnp.array([0.5, 2.0])).to_event(1),
    "correlated": dist.MultivariateNormal(jnp.array([1.0, 2.0]), A),
    "gamma": dist.Gamma(jnp.array([2.0, 3.0]), jnp.array([1.0, 4.0])),
    "Student": dist.StudentT(9.0, 1.0, 0.5),
    "correlated Student": dist.MultivariateStudentT(9.0, jnp.zeros(2), jnp.linalg.cholesky(A)),
    "mixture of scalars": dist.MixtureSameFamily(HALF, dist.Normal(jnp.array([-1.0, 2.0]), jnp.array([0.5, 1.0]))),
    "mixture of vectors": dist.MixtureSameFamily(HALF, PAIR),
    "mixture of kinds": dist.Mixture(HALF, [dist.Normal(0.0, 0.1), dist.StudentT(9.0, 0.0, 1.0)]),
}


@pytest.mark.parametrize("name", GIVEN)
def test_moments_are_those_of_draws(name):
    count = 200_000
    mean, cov = moments(GIVEN[name])
    drawn = np.asarray(Given(GIVEN[name], jnp.zeros(mean.shape)).draws(jax.random.key(0), count))
    std = drawn.std(0)
    assert (np.abs(drawn.mean(0) - mean) < 5 * std / np.sqrt(count)).all()
    # The variance of a second moment is a few times that of a Gaussian's, for the tails here.
    np.testing.assert_allclose(np.cov(drawn.T).reshape(cov.shape), cov, atol=0.03 * float(std.max() ** 2))


@pytest.mark.parametrize("name", GIVEN)
def test_density_is_the_distributions(name):
    d, (mean, _) = GIVEN[name], moments(GIVEN[name])
    density = Given(d, 0.1 * jnp.ones(mean.shape))
    values = jnp.abs(density.draws(jax.random.key(0), 5)) + 0.2
    found = density.log_density(values, jnp.ones(mean.shape, bool))
    at = (values + 0.1).reshape(5, *d.batch_shape, *d.event_shape)
    np.testing.assert_allclose(found, d.log_prob(at).reshape(5, -1).sum(1), rtol=1e-12)


def test_nothing_lies_outside_of_the_support():
    density = Given(dist.Exponential(jnp.ones(1)), jnp.zeros(1))
    assert density.log_density(jnp.array([[-1.0], [1.0]]), jnp.ones(1, bool)).tolist() == [-np.inf, -1.0]


def test_missing_elements_are_left_out_one_by_one_where_they_are_independent():
    density = Given(dist.Gamma(jnp.array([2.0, 3.0]), 1.0), jnp.zeros(2))
    values = jnp.array([[1.0, 0.0]])
    some = density.log_density(values, jnp.array([True, False]))
    np.testing.assert_allclose(some, dist.Gamma(2.0, 1.0).log_prob(1.0)[None], rtol=1e-12)
    together = Given(dist.MultivariateNormal(jnp.zeros(2), A), jnp.zeros(2))
    assert together.log_density(values, jnp.array([True, False])).tolist() == [0.0]


def with_noises(**parts):
    given = {"process_noise": 0.5 * jnp.eye(1), "observation_noise": 0.25 * jnp.eye(1), "initial": MODEL.initial}
    return sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, **(given | parts))


def test_gaussian_filters_take_mean_and_covariance():
    noise = dist.Gamma(4.0, 2.0)
    one = sp.filter(with_noises(process_noise=noise, initial=noise), Y)
    same = sp.Gaussian(jnp.array([2.0]), jnp.eye(1))
    two = sp.filter(with_noises(process_noise=same, initial=same), Y)
    np.testing.assert_allclose(one.mean, two.mean, rtol=1e-12)
    np.testing.assert_allclose(one.log_likelihood, two.log_likelihood, rtol=1e-12)


def test_a_normal_distribution_is_a_gaussian():
    model = with_noises(
        process_noise=dist.Normal(0.0, 0.5**0.5),
        observation_noise=dist.Normal(jnp.zeros(1), 0.5),
        initial=dist.MultivariateNormal(jnp.ones(1), jnp.eye(1)),
    )
    exact = sp.filter(MODEL, Y)
    np.testing.assert_allclose(sp.filter(model, Y).mean, exact.mean, rtol=1e-9)
    for method in (sp.bootstrap(20_000), sp.upf(10_000), sp.auxiliary(sp.bootstrap(20_000))):
        post = sp.filter(model, Y, method=method, key=0)
        np.testing.assert_allclose(post.mean, exact.mean, atol=0.04)
        np.testing.assert_allclose(post.log_likelihood, exact.log_likelihood, atol=0.05)


def test_a_proposal_with_a_covariance_of_its_own_keeps_the_mean_of_the_noise():
    model = with_noises(process_noise=dist.Normal(3.0, 0.5**0.5))
    y = sp.simulate(model, 6, key=2)[1]
    exact, own = sp.filter(model, y), {"process_noise": jnp.eye(1)}
    for proposal in (sp.proposals.prior(**own), sp.proposals.carried(sp.ekf(), **own)):
        post = sp.filter(model, y, method=sp.particle_filter(10_000, proposal=proposal), key=0)
        np.testing.assert_allclose(post.mean, exact.mean, atol=0.04)
        # Drawn about the state without the mean, 4σ away, hardly a particle would count.
        assert float(post.ess.min()) > 1000


def test_a_heavy_tail_forgives_an_outlier():
    y = jnp.zeros((10, 1)).at[5].set(8.0)
    gaussian = sp.filter(with_noises(observation_noise=0.5 * jnp.eye(1)), y)
    tailed = sp.filter(with_noises(observation_noise=dist.StudentT(2.0, 0.0, 0.5)), y, method=sp.bootstrap(5000), key=0)
    assert abs(float(tailed.mean[5, 0])) < 0.3 * abs(float(gaussian.mean[5, 0]))
    assert np.isfinite(tailed.nis).all()


def test_no_finite_variance_needs_a_covariance_beside():
    tailed = dist.StudentT(2.0, 0.0, 0.5)
    with pytest.raises(ValueError, match=r"observation_noise: .* no finite variance.*sp.Additive\(cov, distribution"):
        sp.filter(with_noises(observation_noise=tailed), Y)
    both = with_noises(observation_noise=sp.Additive(0.25 * jnp.eye(1), distribution=tailed))
    np.testing.assert_allclose(sp.filter(both, Y).mean, sp.filter(MODEL, Y).mean, rtol=1e-12)
    assert np.isfinite(sp.filter(both, Y, method=sp.upf(100), key=0).mean).all()
    with pytest.raises(ValueError, match="initial: the variance of this distribution"):
        with_noises(initial=tailed)
    with pytest.raises(ValueError, match=r"cov must be \(1, 1\) beside a distribution of 1"):
        sp.Additive(jnp.eye(2), distribution=tailed)
    with pytest.raises(ValueError, match="distribution must be an object with sample and log_prob"):
        sp.Additive(jnp.eye(2), distribution=3.0)


class LogChiSquare:
    """Only what is asked for: the logarithm of the square of a standard normal number."""

    mean, variance = jnp.full(1, -1.2703628454614782), jnp.full(1, np.pi**2 / 2)

    def sample(self, key, sample_shape=()):
        return jnp.log(jax.random.normal(key, (*sample_shape, 1)) ** 2)

    def log_prob(self, value):
        return (value - jnp.exp(value)) / 2 - np.log(2 * np.pi) / 2


def test_a_distribution_needs_no_more_than_draws_density_and_moments():
    model = with_noises(observation_noise=LogChiSquare(), process_noise=0.1 * jnp.eye(1))
    _, y = sp.simulate(model, 20, key=0)
    post = sp.filter(model, y, method=sp.bootstrap(2000), key=1)
    assert float(post.log_likelihood) > float(sp.filter(model, y).log_likelihood)


def test_no_moments_at_all_leave_a_particle_filter():
    logarithm = dist.TransformedDistribution(dist.Gamma(2.0, 1.0), dist.transforms.ExpTransform().inv)
    model = with_noises(observation_noise=logarithm)
    assert np.isfinite(sp.filter(model, Y, method=sp.bootstrap(500), key=0).mean).all()
    with pytest.raises(ValueError, match="observation_noise: this distribution has no finite variance"):
        sp.filter(model, Y)


def test_simulate_draws_from_the_distribution():
    model = sp.StateSpaceModel(
        lambda x, u, w: w,
        lambda x, u: x,
        sp.NonAdditive(dist.Gamma(0.5, 1.0)),
        dist.Exponential(1e6),
        dist.Gamma(0.5, 1.0),
    )
    x, y = sp.simulate(model, 4000, key=0)
    assert float(x.min()) > 0
    assert float((y - x).min()) >= 0
    # Third central moment of Gamma(a): 2a, with a standard error of 0.35 here.
    assert abs(float(((x - 0.5) ** 3).mean()) - 1) < 1.0


def test_a_mixture_keeps_both_modes_where_a_gaussian_cannot():
    two = dist.MixtureSameFamily(dist.Categorical(jnp.array([0.5, 0.5])), dist.Normal(jnp.array([-3.0, 3.0]), 0.3))
    model = with_noises(initial=two, process_noise=0.01 * jnp.eye(1))
    post = sp.filter(
        model, jnp.full((3, 1), jnp.nan), method=sp.bootstrap(4000), key=0, keep=("mean", "std", "particles")
    )
    assert float(post.std[-1, 0]) > 2
    assert float(jnp.mean(jnp.abs(post.particles[-1]) < 1)) < 0.02
