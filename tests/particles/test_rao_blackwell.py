"""Rao-Blackwellised filters: exact in what is not drawn, and less scattered for it."""

import jax
import jax.numpy as jnp
import numpy as np

import sigmapoint as sp

# A phase that drifts, and a level and its speed seen through it: linear given the phase.
MODEL = sp.StateSpaceModel(
    lambda x, u: jnp.stack([x[0] + 0.3, 0.95 * x[1] + 0.2 * x[2] * jnp.cos(x[0]), 0.9 * x[2]]),
    lambda x, u: jnp.stack([jnp.sin(x[0]) + x[1], x[2]]),
    jnp.diag(jnp.array([0.04, 0.05, 0.1])),
    0.05 * jnp.eye(2),
    sp.Gaussian(jnp.array([0.0, 1.0, 0.5]), jnp.diag(jnp.array([1.0, 0.5, 0.5]))),
    state_names=("phase", "level", "speed"),
)
Y = np.array([[1.0, 0.3], [1.6, np.nan], [1.5, 0.9], [np.nan, np.nan], [0.7, 0.2], [0.2, 0.4]])
METHOD = sp.rao_blackwellised(4000, ("phase",))


def test_the_answer_is_that_of_many_particles():
    exact = sp.filter(MODEL, Y, method=sp.bootstrap(200_000), key=1)
    post = sp.filter(MODEL, Y, method=sp.rao_blackwellised(20_000, ("phase",)), key=0)
    # Standard errors of both together, from 16 runs: 0.015 of a mean, 0.045 of a deviation (a belief with tails), 0.03.
    assert (np.abs(np.asarray(post.mean - exact.mean)) < 0.08 * np.asarray(exact.std)).all()
    np.testing.assert_allclose(post.std, exact.std, rtol=0.15)
    np.testing.assert_allclose(post.log_likelihood, exact.log_likelihood, atol=0.15)
    np.testing.assert_allclose(post.innovation_cov, exact.innovation_cov, rtol=0.1, atol=0.01)


def test_correlated_noises_are_told_by_what_was_drawn():
    """A level whose noise is that of the phase: to draw one is to know the other."""
    Q = jnp.array([[0.1, 0.09, 0.0], [0.09, 0.1, 0.0], [0.0, 0.0, 0.1]])
    model = sp.StateSpaceModel(
        MODEL.dynamics, lambda x, u: x[1:2], Q, 0.05 * jnp.eye(1), MODEL.initial, state_names=MODEL.state_names
    )
    exact = sp.filter(model, Y[:, :1], method=sp.bootstrap(200_000), key=1)
    post = sp.filter(model, Y[:, :1], method=sp.rao_blackwellised(20_000, ("phase",)), key=0)
    assert (np.abs(np.asarray(post.mean - exact.mean)) < 0.06 * np.asarray(exact.std)).all()
    np.testing.assert_allclose(post.std, exact.std, rtol=0.06)


def test_the_likelihood_scatters_less_than_with_all_elements_drawn():
    def spread(method):
        keys = jax.random.split(jax.random.key(0), 60)
        return float(jnp.std(jax.vmap(lambda key: sp.filter(MODEL, Y, method=method, key=key).log_likelihood)(keys)))

    assert spread(sp.rao_blackwellised(200, (0,))) < 0.6 * spread(sp.bootstrap(200))


def test_what_is_drawn_has_no_variance_left_and_the_whole_has():
    live = sp.online(MODEL, METHOD)
    state = live.predict(live.update(live.init(key=0), Y[0])[0])
    within = np.asarray(jax.vmap(lambda belief: belief.cov)(state.filters.belief))
    assert (np.abs(within[:, 0]) < 1e-12).all()
    assert (within[:, 1, 1] > 0.01).all()
    assert float(state.std[0]) > 0.1


def test_by_name_or_by_place_is_the_same():
    one = sp.filter(MODEL, Y, method=sp.rao_blackwellised(50, ("phase",)), key=0)
    two = sp.filter(MODEL, Y, method=sp.rao_blackwellised(50, (0,)), key=0)
    np.testing.assert_array_equal(one.mean, two.mean)
