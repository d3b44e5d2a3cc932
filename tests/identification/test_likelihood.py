"""The density of parameters: sums over series, derivatives, and what happens where there is none."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
import pytest

import sigmapoint as sp
from sigmapoint.identification.profile import Profile

THETA = {"q": sp.positive(0.5, 0.5), "r": sp.positive(0.2, 0.1)}
METHOD = sp.srekf()


def model(theta):
    start = sp.Gaussian(jnp.zeros(1), jnp.eye(1))
    return sp.StateSpaceModel(
        lambda x, u: 0.9 * x + u["push"],
        lambda x, u: jnp.sin(x),
        theta["q"] * jnp.eye(1),
        theta["r"] * jnp.eye(1),
        start,
    )


r = np.random.default_rng(0)
Y, U = [r.normal(size=(t, 1)) for t in (9, 5, 7)], [{"push": r.normal(size=(t, 1))} for t in (9, 5, 7)]
Z = jnp.array([0.3, -0.2])


@pytest.fixture(scope="module")
def density():
    return sp.log_posterior(model, THETA, Y[0], U[0], METHOD)


def test_series_are_independent():
    density = sp.log_posterior(model, THETA, Y, U, METHOD)
    theta = density.theta(Z)
    each = [sp.filter(model(theta), y, u, METHOD).log_likelihood for y, u in zip(Y, U)]
    assert density.log_likelihood(Z) == pytest.approx(float(sum(each)), rel=1e-12)
    assert density.measured == 21


def test_it_is_likelihood_and_standard_normal_prior(density):
    prior = -0.5 * float(Z @ Z) - np.log(2 * np.pi)
    assert density.log_prior(Z) == pytest.approx(prior, rel=1e-12)
    assert density(Z) == pytest.approx(float(density.log_likelihood(Z)) + prior, rel=1e-12)


def test_jit_grad_hessian_and_vmap_agree(density):
    slope = jax.grad(density)(Z)
    h = 1e-5
    differences = [(density(Z + h * e) - density(Z - h * e)) / (2 * h) for e in jnp.eye(2)]
    np.testing.assert_allclose(slope, differences, rtol=1e-8)
    many = jnp.stack([Z, -Z])
    np.testing.assert_allclose(jax.jit(jax.vmap(jax.grad(density)))(many)[0], slope, rtol=1e-12)
    np.testing.assert_allclose(jax.vmap(density)(many), [jax.jit(density)(z) for z in many], rtol=1e-12)
    grad = jax.jit(jax.grad(density))
    bent = [(grad(Z + h * e) - grad(Z - h * e)) / (2 * h) for e in jnp.eye(2)]
    np.testing.assert_allclose(jax.hessian(density)(Z), bent, rtol=1e-7)


@pytest.mark.parametrize("z", [[1e4, 0.0], [0.0, jnp.nan]])
def test_where_there_is_no_value_it_is_minus_infinity_without_a_slope(density, z):
    value, slope = jax.value_and_grad(density)(jnp.array(z))
    assert value == -jnp.inf
    assert np.array_equal(slope, [0.0, 0.0])
    assert density(jnp.array(z)) == -jnp.inf


def boxed(theta):
    start = sp.Gaussian(jnp.zeros(1), jnp.eye(1))
    step = sp.blackbox(lambda x, u: 0.9 * x)
    return sp.StateSpaceModel(step, lambda x, u: x, theta * jnp.eye(1), jnp.eye(1), start)


def no_model(theta):
    return theta


@pytest.mark.parametrize(
    ("build", "theta", "y", "more", "said"),
    [
        (model, {}, Y[0], {}, "theta has no unknown parameters"),
        (no_model, 1.0, Y[0], {}, r"build\(theta\) must be a sp.StateSpaceModel"),
        (model, THETA, Y[0][:, 0], {}, r"y must be \(T, m\).*pass y\[:, None\]"),
        (model, THETA, [], {}, "y is an empty list"),
        (model, THETA, Y, {"u": U[0]}, "u must be a list of 3 pytrees"),
        (model, THETA, Y[0], {"u": U[1]}, r"u\['push'\] must have one row for each of the 9 rows of y"),
        (model, THETA, Y[0] + np.inf, {"u": U[0]}, "y has infinite values"),
        (model, THETA, Y[0] + np.nan, {"u": U[0]}, "y has no measurements"),
        (model, THETA, Y[0], {"u": U[0], "prior": -1.0}, "prior must be 0"),
        (model, THETA, Y[0], {"u": U[0], "steps": 0}, "steps must be a whole number of at least 1"),
        (boxed, sp.positive(1.0, 1.0), Y[0], {}, "blackbox has no derivative, which fit needs: use sp.em .* sp.joint"),
        (
            lambda z: model({"q": z[0], "r": z[0]}),
            sp.Gaussian(jnp.ones(2), jnp.ones((2, 2))),
            Y[0],
            {"u": U[0]},
            "theta has a singular covariance",
        ),
    ],
)
def test_wrong_input_is_named(build, theta, y, more, said):
    with pytest.raises(ValueError, match=said):
        sp.fit(build, theta, y, **more)


def test_a_start_without_a_likelihood_is_named():
    start = sp.Gaussian(jnp.zeros(1), jnp.eye(1))

    def undefined(theta):
        return sp.StateSpaceModel(lambda x, u: jnp.log(-theta) * x, lambda x, u: x, jnp.eye(1), jnp.eye(1), start)

    with pytest.raises(ValueError, match="not finite at the start, the centre of theta"):
        sp.fit(undefined, sp.real(0.5, 0.1), Y[0], method=METHOD)


def test_a_profile_ends_where_it_first_falls_by_two():
    fall = np.array([-5.0, -1.0, -3.0, 0.0, -3.0, -1.0, -5.0])
    low, high = Profile("a", np.arange(7.0), fall, 0.0).interval
    np.testing.assert_allclose([low, high], [3 - 2 / 6**0.5, 3 + 2 / 6**0.5])
    assert np.isnan(Profile("a", np.arange(7.0), fall / 10, 0.0).interval).all()


def test_a_distribution_without_a_variance_is_a_model():
    tailed = dist.StudentT(2.0, jnp.zeros(1), jnp.ones(1))
    model = sp.StateSpaceModel(
        lambda x, u: x, lambda x, u: x, jnp.eye(1), tailed, sp.Gaussian(jnp.zeros(1), jnp.eye(1))
    )
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):  # numpyro counts on them
        found = sp.smc2(
            lambda theta: eqx.tree_at(lambda m: m.process_noise, model, sp.Additive(theta * jnp.eye(1))),
            sp.positive(1.0, 0.5),
            np.ones((4, 1)),
            key=0,
            method=sp.bootstrap(20),
            samples=8,
        )
    assert np.isfinite(found.log_evidence)
