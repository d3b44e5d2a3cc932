"""A bearing that crosses ±π again and again gives the answer of the unwrapped one, forward and backward."""

from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest

import sigmapoint as sp

T = 4000
TURN = 2 * np.pi


@cache
def _models():
    """A rotor, (angle, rate), and its bearing: wrapped to (−π, π], and as it is."""

    def f(x, u):
        return jnp.stack([x[0] + 0.1 * x[1], x[1] + 0.01 * jnp.sin(x[0])])

    parts = {
        "process_noise": np.diag([1e-4, 1e-3]),
        "observation_noise": np.array([[0.04]]),
        "initial": sp.Gaussian(np.array([0.5, 3.5]), np.diag([0.1, 0.2])),
    }
    plain = sp.StateSpaceModel(f, lambda x, u: x[:1], **parts)
    wrapped = sp.StateSpaceModel(
        lambda x, u: f(x, u),
        lambda x, u: jnp.atan2(jnp.sin(x[:1]), jnp.cos(x[:1])),
        **parts,
        state_space=sp.angles(0),
        observation_space=sp.angles(0),
    )
    return plain, wrapped


@cache
def _series():
    r = np.random.default_rng(1)
    angle, rate, y = 0.5, 3.5, np.empty((T, 1))
    for k in range(T):
        y[k] = angle + 0.2 * r.normal()
        angle, rate = angle + 0.1 * rate + 0.01 * r.normal(), rate + 0.01 * np.sin(angle) + 0.0316 * r.normal()
    y[300:310] = np.nan
    return y


@pytest.mark.parametrize(
    "method",
    [
        sp.ekf(),
        sp.srukf(),
        pytest.param(sp.cdkf(), marks=pytest.mark.slow),
        pytest.param(sp.srckf(), marks=pytest.mark.slow),
        sp.srghkf(),
        sp.augmented(sp.srcdkf()),
        sp.iterated(sp.srukf(), 3),
    ],
    ids=str,
)
@pytest.mark.parametrize("run", [pytest.param(sp.filter, marks=pytest.mark.slow), sp.smooth])
def test_wrapped_bearing_is_the_unwrapped_one(method, run):
    y = _series()
    wrapped_y = (y + np.pi) % TURN - np.pi
    assert np.sum(np.abs(np.diff(wrapped_y[~np.isnan(y)])) > np.pi) >= 100
    plain, wrapped = _models()
    a, b = run(plain, y, None, method), run(wrapped, wrapped_y, None, method)
    difference = np.array(a.mean - b.mean)
    difference[:, 0] -= TURN * np.round(difference[:, 0] / TURN)
    assert np.abs(difference).max() < 1e-8
    assert (np.abs(b.mean[:, 0]) <= np.pi + 1e-12).all()
    np.testing.assert_allclose(b.std, a.std, rtol=1e-8)
    np.testing.assert_allclose(b.nis, a.nis, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(b.log_likelihood, a.log_likelihood, rtol=1e-9)


def test_a_manifold_of_the_users_own():
    """A positive quantity filtered through its logarithm: retract and residual carry it."""
    log_space = sp.Manifold(lambda a, b: jnp.log(a / b), lambda m, d: m * jnp.exp(d))
    noise = {"process_noise": 0.01 * np.eye(1), "observation_noise": 0.1 * np.eye(1)}
    direct = sp.StateSpaceModel(
        lambda x, u: 0.9 * x, lambda x, u: x, **noise, initial=sp.Gaussian(np.zeros(1), np.eye(1))
    )
    positive = sp.StateSpaceModel(
        lambda x, u: x**0.9,
        lambda x, u: x,
        **noise,
        initial=sp.Gaussian(np.ones(1), np.eye(1)),
        state_space=log_space,
        observation_space=log_space,
    )
    y = np.random.default_rng(0).normal(size=(30, 1))
    for run in (sp.filter, sp.smooth):
        a, b = run(direct, y, None, sp.srcdkf()), run(positive, np.exp(y), None, sp.srcdkf())
        np.testing.assert_allclose(jnp.log(b.mean), a.mean, atol=1e-12)
        np.testing.assert_allclose(b.log_likelihood, a.log_likelihood, rtol=1e-12)


def test_simulated_states_stay_in_their_space_however_the_noise_enters():
    one = np.eye(1)
    for noise, f in ((one, lambda x, u: x + 0.5), (sp.NonAdditive(one), lambda x, u, w: x + 0.5 + w)):
        model = sp.StateSpaceModel(
            f, lambda x, u: x, noise, one, sp.Gaussian(np.zeros(1), one), state_space=sp.angles(0)
        )
        x, _ = sp.simulate(model, 50, key=0)
        assert (np.abs(x) <= np.pi).all()
        assert (np.abs(np.diff(x, axis=0)) > np.pi).any()
