"""Where variances vanish or states and sensors repeat each other: every answer is that of the smaller problem."""

import jax.numpy as jnp
import numpy as np
import pytest

import sigmapoint as sp

METHODS = [sp.ekf(), sp.srekf(), sp.srukf(), sp.srcdkf(), sp.ukf(), sp.iterated(sp.srcdkf(), 3)]
R = np.random.default_rng(0)


def _linear(F, H, Q, R, m0, P0):
    F, H = jnp.asarray(F), jnp.asarray(H)
    return sp.StateSpaceModel(lambda x, u: F @ x, lambda x, u: H @ x, Q, R, sp.Gaussian(m0, P0))


def _exact_series(F, H, T=8):
    x, y = R.normal(size=2), []
    for _ in range(T):
        y.append(H @ x)
        x = F @ x + 0.1 * R.normal(size=2)
    return np.array(y)


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_states_that_are_copies_of_each_other(method):
    y = np.array([[0.3], [-0.2], [0.5], [0.1]])
    both = np.ones((2, 2))
    twice = _linear(0.9 * np.eye(2), [[1.0, 0.0]], 0.1 * both, [[0.2]], np.zeros(2), both)
    once = _linear([[0.9]], [[1.0]], [[0.1]], [[0.2]], np.zeros(1), np.eye(1))
    for run in (sp.filter, sp.smooth):
        a, b = run(twice, y, None, method), run(once, y, None, method)
        for i in (0, 1):
            np.testing.assert_allclose(a.mean[:, i], b.mean[:, 0], rtol=1e-9)
            np.testing.assert_allclose(a.std[:, i], b.std[:, 0], rtol=1e-9)


@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize("second", [[1.0, 0.3], [3.0, 0.9]])
def test_exact_sensors_that_repeat_each_other_count_once(method, second):
    F, H = np.array([[1.0, 0.1], [0.0, 0.95]]), np.array([[1.0, 0.3], second])
    y = _exact_series(F, H)
    rest = (0.01 * np.eye(2), np.zeros(2), np.eye(2))
    twice = _linear(F, H, rest[0], np.zeros((2, 2)), *rest[1:])
    once = _linear(F, H[:1], rest[0], np.zeros((1, 1)), *rest[1:])
    a, b = sp.filter(twice, y, None, method), sp.filter(once, y[:, :1], None, method)
    np.testing.assert_allclose(a.mean, b.mean, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(a.std, b.std, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(a.log_likelihood, b.log_likelihood, rtol=1e-8)
    np.testing.assert_allclose(a.nis, b.nis, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_a_sensor_that_measures_nothing_exactly_says_nothing(method):
    y = R.normal(size=(6, 1))
    rest = (0.1 * np.eye(1), np.zeros(1), np.eye(1))
    f = lambda x, u: 0.9 * x  # noqa: E731
    plain = sp.StateSpaceModel(f, lambda x, u: x, rest[0], 0.1 * np.eye(1), sp.Gaussian(*rest[1:]))
    more = sp.StateSpaceModel(
        f, lambda x, u: jnp.concatenate([x, jnp.full(1, 5.0)]), rest[0], np.diag([0.1, 0.0]), sp.Gaussian(*rest[1:])
    )
    a = sp.filter(more, np.column_stack([y, np.full(6, 705.0)]), None, method)
    b = sp.filter(plain, y, None, method)
    np.testing.assert_allclose(a.mean, b.mean, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(a.nis, b.nis, rtol=1e-9)
    np.testing.assert_allclose(a.log_likelihood, b.log_likelihood, rtol=1e-9)


@pytest.mark.parametrize("R", [np.zeros((2, 2)), np.ones((2, 2)), 1e-20 * np.eye(2)], ids=["zero", "rank one", "tiny"])
@pytest.mark.parametrize("method", [sp.ukf(), sp.srukf(), sp.srcdkf(), sp.ekf()], ids=str)
def test_iterating_with_exact_measurements_changes_nothing_on_a_linear_model(R, method):
    r = np.random.default_rng(1)
    F, H, y = 0.5 * r.normal(size=(4, 4)), r.normal(size=(2, 4)), r.normal(size=(10, 2))
    model = _linear(F, H, 0.1 * np.eye(4), R, np.zeros(4), np.eye(4))
    a, b = sp.filter(model, y, None, sp.srekf()), sp.filter(model, y, None, sp.iterated(method, 3))
    np.testing.assert_allclose(b.mean, a.mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(b.std, a.std, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("method", METHODS[:5], ids=str)
def test_a_variance_that_overflows_is_not_a_certainty(method):
    model = _linear([[1e100]], [[1.0]], [[1.0]], [[1.0]], np.zeros(1), np.eye(1))
    std = np.asarray(sp.filter(model, np.full((6, 1), np.nan), None, method).std[:, 0])
    assert (np.isnan(std) | (std >= 1)).all()


def test_a_value_that_is_not_a_number_where_nothing_was_measured_does_no_harm():
    model = sp.StateSpaceModel(
        lambda x, u: 0.9 * x,
        lambda x, u: jnp.stack([x[0], jnp.log(-1.0 - x[0] ** 2)]),
        0.1 * np.eye(1),
        np.eye(2),
        sp.Gaussian(np.zeros(1), np.eye(1)),
    )
    y = np.array([[1.0, np.nan], [0.5, np.nan]])
    for method in (sp.ekf(), sp.srcdkf()):
        assert np.isfinite(sp.filter(model, y, None, method, keep=("mean", "std")).mean).all()
