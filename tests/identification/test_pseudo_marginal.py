"""One step of Metropolis–Hastings with an estimated likelihood, and the estimates themselves."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from identification.level import THETA, Y, build

import sigmapoint as sp
from sigmapoint.filtering import fitting
from sigmapoint.identification.adaptation import ACCEPTED, gains, learned
from sigmapoint.identification.chains import diagnosed
from sigmapoint.identification.likelihood import posterior_of
from sigmapoint.identification.pseudo_marginal import Point, moved

SERIES = [Y, Y[:7]]
Z = jnp.array([0.4])


@pytest.fixture(scope="module")
def posterior():
    return posterior_of(build, THETA, SERIES, None, sp.bootstrap(20), fitting)


def chain(posterior, again, steps=4000, chains=20):
    """Of a likelihood of 1, estimated without bias, the noisier the larger z; `again` makes it anew at every step."""

    def estimate(z, key):
        spread = 2 * jax.nn.sigmoid(2 * z[0])
        return Point(z, spread * jax.random.normal(key) - spread**2 / 2)

    def step(point, key):
        walk, draw, anew = jax.random.split(key, 3)
        point = estimate(point.z, anew) if again else point
        point, _ = moved(draw, posterior, point, 2 * jax.random.normal(walk, (1,)), estimate)
        return point, point.z

    def one(key):
        return jax.lax.scan(step, Point(jnp.zeros(1), jnp.zeros(())), jax.random.split(key, steps))[1]

    return np.asarray(jax.jit(jax.vmap(one))(jax.random.split(jax.random.key(0), chains)))[..., 0]


def deviations(z):
    """The mean, in standard errors by the spread of the means of independent chains."""
    means = z.mean(axis=1)
    return means.mean() / (means.std(ddof=1) / np.sqrt(len(means)))


def test_the_chain_is_exact_as_it_keeps_the_estimate_of_where_it_is(posterior):
    kept = chain(posterior, again=False)
    assert abs(deviations(kept)) < 4
    assert kept.var() == pytest.approx(1, abs=0.1)  # of the prior; 4 standard errors of some 3000 independent draws
    # Made anew, the noise of where it is would drive it to where there is more noise, or less.
    assert abs(deviations(chain(posterior, again=True))) > 20


def test_every_series_draws_with_a_key_of_its_own_and_may_end_early(posterior):
    key, until = jax.random.key(3), jnp.asarray(7)
    model = build(posterior.theta(Z))
    keys = jax.random.split(key)
    each = [sp.filter(model, Y[:7], method=sp.bootstrap(20), key=k, keep=()).log_likelihood for k in keys]
    some, ahead = jax.jit(lambda z, key: posterior.filtered(z, key, until))(Z, key)
    assert some == pytest.approx(float(sum(each)), rel=1e-6)  # draws are of 32 bits
    assert each[0] != each[1]
    assert (ahead.step == 7).all()


def test_an_estimate_needs_a_key(posterior):
    for call in (posterior, posterior.log_likelihood):
        with pytest.raises(ValueError, match="key is missing: a particle filter draws"):
            call(Z)


def test_steps_learn_along_the_direction_they_took():
    factor = jnp.array([[1.0, 0.0], [0.5, 2.0]])
    u, gain, accepted = jnp.array([0.6, -0.8]) * 3, jnp.asarray(0.7), jnp.asarray(0.9)
    after = learned(factor, u, gain, accepted)
    v = np.array([0.6, -0.8])
    middle = np.eye(2) + 0.7 * (0.9 - ACCEPTED) * np.outer(v, v)
    np.testing.assert_allclose(after @ after.T, factor @ middle @ factor.T, rtol=1e-12)
    assert (learned(factor, u, jnp.asarray(0.0), accepted) == factor).all()


def test_nothing_is_learned_after_the_warm_up():
    gain = gains(10, 20, size=2)
    assert (gain[:10] > 0).all()
    assert (np.diff(gain[:10]) <= 0).all()
    assert not gain[10:].any()


def test_chains_that_differ_are_seen():
    z = np.random.default_rng(0).normal(size=(4, 500, 2))
    z[0, :, 1] += 3
    ess, r_hat = diagnosed(z)
    assert r_hat[0] < 1.02 < 1.2 < r_hat[1]
    assert ess[1] < 50 < 1500 < ess[0] < 2500
