"""Posterior linearisation: on a linear model it is the smoother; parallel in time it is what it is in sequence."""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from laws import affine_case
from laws.linear import case

import sigmapoint as sp
from sigmapoint import affine, parallel


@pytest.mark.parametrize("in_parallel", [False, True])
@pytest.mark.parametrize(
    ("method", "n"), [(sp.srcdkf(), 2), pytest.param(sp.ekf(), 5, marks=pytest.mark.slow), (sp.ukf(), 1)]
)
def test_on_a_linear_model_it_is_the_kalman_filter_and_smoother(method, n, in_parallel):
    model, y, u, filtered, smoothed = case(n)
    found = sp.smooth(model, y, u, method, smoother=sp.ipls(2, parallel=in_parallel))
    np.testing.assert_allclose(found.mean, smoothed.mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.cov, smoothed.cov, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.innovation, filtered.innovation, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.innovation_cov, filtered.innovation_cov, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.nis, filtered.nis, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found.log_likelihood, filtered.log_likelihood, rtol=1e-10)


@pytest.mark.parametrize(("T", "n", "m"), [(10_000, 5, 2), (37, 2, 4), (1, 3, 1), (2, 1, 1)])
def test_affine_elements_combine_to_what_the_sequence_gives(T, n, m):
    model = affine_case.case(T, n, m)

    @partial(jax.jit, static_argnums=0)
    def run(form):
        beliefs = form.filtered(model)
        return beliefs, form.smoothed(model, beliefs)

    for x, y in zip(run(parallel), run(affine)):
        scale = jnp.sqrt(jnp.sum(y.factor**2, -1))
        assert (jnp.abs(x.mean - y.mean) < 1e-8 * scale).all()
        P, Q = (b.factor @ b.factor.mT for b in (x, y))
        assert (jnp.abs(P - Q) < 1e-8 * scale[..., None] * scale[..., None, :]).all()


@cache
def _pendulum() -> sp.StateSpaceModel:
    return sp.StateSpaceModel(
        lambda x, u: jnp.stack([x[0] + 0.1 * x[1], x[1] - 0.98 * jnp.sin(x[0])]),
        lambda x, u: jnp.sin(x[:1]),
        0.01 * jnp.array([[1 / 3, 1 / 2], [1 / 2, 1.0]]),
        0.05 * jnp.eye(1),
        sp.Gaussian(jnp.array([1.5, 0.0]), 0.1 * jnp.eye(2)),
    )


@pytest.mark.parametrize("method", [sp.srcdkf(), pytest.param(sp.ekf(), marks=pytest.mark.slow)])
def test_parallel_is_sequential_on_a_nonlinear_model(method):
    model = _pendulum()
    y = sp.simulate(model, 21, key=jax.random.key(1))[1].at[10:14].set(jnp.nan)
    one, other = (sp.smooth(model, y, method=method, smoother=sp.ipls(4, parallel=p)) for p in (False, True))
    for name in ("mean", "cov", "nis", "log_likelihood"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-8, atol=1e-9)


def test_with_derivatives_it_ends_where_the_posterior_of_the_trajectory_is_highest():
    """The iterated extended Kalman smoother is Gauss-Newton on it (Bell 1994)."""
    model = _pendulum()
    y = sp.simulate(model, 40, key=jax.random.key(2))[1]
    found = sp.smooth(model, y, method=sp.ekf(), smoother=sp.ipls(40))

    def cost(x):
        moved = x[1:] - jax.vmap(model.dynamics, (0, None))(x[:-1], None)
        seen = y - jax.vmap(model.observation, (0, None))(x, None)
        first = x[0] - model.initial.mean
        Q, R, P = (jnp.linalg.inv(c) for c in (model.process_noise.cov, model.observation_noise.cov, model.initial.cov))
        return first @ P @ first + jnp.sum((moved @ Q) * moved) + jnp.sum((seen @ R) * seen)

    slope = jax.grad(cost)(found.mean)
    assert jnp.abs(slope * found.std).max() < 1e-7
    start = sp.smooth(model, y, method=sp.ekf()).mean
    assert cost(found.mean) < cost(start) - 1e-3


def test_sigma_points_end_where_linearising_again_changes_nothing():
    model = _pendulum()
    y = sp.simulate(model, 40, key=jax.random.key(2))[1]
    one, other = (sp.smooth(model, y, method=sp.srukf(), smoother=sp.ipls(passes)) for passes in (30, 31))
    np.testing.assert_allclose(one.mean, other.mean, atol=1e-9)
    np.testing.assert_allclose(one.std, other.std, atol=1e-9)


def test_noise_inside_the_functions_is_that_outside_where_it_is_added_there():
    model = _pendulum()
    inside = sp.StateSpaceModel(
        lambda x, u, w: model.dynamics(x, u) + w,
        lambda x, u, v: model.observation(x, u) + v,
        sp.NonAdditive(model.process_noise.cov),
        sp.NonAdditive(model.observation_noise.cov),
        model.initial,
    )
    y = sp.simulate(model, 7, key=jax.random.key(3))[1]
    one, other = (sp.smooth(m, y, method=sp.srekf(), smoother=sp.ipls(3, parallel=True)) for m in (model, inside))
    np.testing.assert_allclose(one.mean, other.mean, atol=1e-10)
    np.testing.assert_allclose(one.cov, other.cov, atol=1e-10)


def test_a_bearing_that_wraps_is_the_unwrapped_one():
    def model(space):
        return sp.StateSpaceModel(
            lambda x, u: jnp.stack([x[0] + x[1], x[1]]),
            lambda x, u: x[:1],
            jnp.diag(jnp.array([1e-4, 1e-6])),
            1e-2 * jnp.eye(1),
            sp.Gaussian(jnp.array([0.0, 0.4]), jnp.diag(jnp.array([0.01, 0.01]))),
            state_space=space,
            observation_space=space,
        )

    plain = model(None)
    y = sp.simulate(plain, 20, key=jax.random.key(0))[1]
    wrapped = jnp.arctan2(jnp.sin(y), jnp.cos(y))
    one = sp.smooth(plain, y, method=sp.srukf(), smoother=sp.ipls(2))
    other = sp.smooth(model(sp.angles(0)), wrapped, method=sp.srukf(), smoother=sp.ipls(2, parallel=True))
    turns = (one.mean[:, 0] - other.mean[:, 0]) / (2 * jnp.pi)
    np.testing.assert_allclose(turns, jnp.round(turns), atol=1e-9)
    np.testing.assert_allclose(one.std, other.std, atol=1e-9)


def test_a_method_that_carries_its_points_is_refused():
    with pytest.raises(ValueError, match="ipls: a method that carries one point set"):
        sp.smooth(_pendulum(), np.ones((3, 1)), method=sp.augmented(sp.ukf()), smoother=sp.ipls())
    with pytest.raises(ValueError, match="passes"):
        sp.ipls(0)
