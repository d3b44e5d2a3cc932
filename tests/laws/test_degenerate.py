"""Where variances vanish or states and sensors repeat each other: every answer is that of the smaller problem."""

import jax.numpy as jnp
import numpy as np
import pytest

import sigmapoint as sp
from sigmapoint.breakdown import BreakdownWarning
from sigmapoint.linear_algebra.triangularization import tria

METHODS = [sp.ekf(), sp.srekf(), sp.srukf(), sp.srcdkf(), sp.ukf(), sp.iterated(sp.srcdkf(), 3)]
R = np.random.default_rng(0)


def _f(x, u):  # one function for every case, so that a method is compiled once for each size
    return u["F"] @ x


def _h(x, u):
    return u["H"] @ x


def _linear(run, y, method, F, H, Q, R, m0, P0):
    model = sp.StateSpaceModel(_f, _h, Q, R, sp.Gaussian(m0, P0))
    u = {name: np.broadcast_to(value, (len(y), *np.shape(value))) for name, value in (("F", F), ("H", H))}
    return run(model, y, u, method)


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
    a = _linear(sp.smooth, y, method, 0.9 * np.eye(2), [[1.0, 0.0]], 0.1 * both, [[0.2]], np.zeros(2), both)
    b = _linear(sp.smooth, y, method, [[0.9]], [[1.0]], [[0.1]], [[0.2]], np.zeros(1), np.eye(1))
    for i in (0, 1):
        np.testing.assert_allclose(a.mean[:, i], b.mean[:, 0], rtol=1e-9)
        np.testing.assert_allclose(a.std[:, i], b.std[:, 0], rtol=1e-9)
    np.testing.assert_allclose(a.log_likelihood, b.log_likelihood, rtol=1e-9)


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_exact_sensors_that_repeat_each_other_count_once(method):
    F, Q, start = np.array([[1.0, 0.1], [0.0, 0.95]]), 0.01 * np.eye(2), (np.zeros(2), np.eye(2))
    for second in ([1.0, 0.3], [3.0, 0.9]):
        H = np.array([[1.0, 0.3], second])
        y = _exact_series(F, H)
        a = _linear(sp.filter, y, method, F, H, Q, np.zeros((2, 2)), *start)
        b = _linear(sp.filter, y[:, :1], method, F, H[:1], Q, np.zeros((1, 1)), *start)
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


@pytest.mark.parametrize("method", [sp.ukf(), sp.srukf(), sp.srcdkf(), sp.ekf()], ids=str)
def test_iterating_with_exact_measurements_changes_nothing_on_a_linear_model(method):
    r = np.random.default_rng(1)
    F, H, y = 0.5 * r.normal(size=(4, 4)), r.normal(size=(2, 4)), r.normal(size=(10, 2))
    for name, R in {"zero": np.zeros((2, 2)), "rank one": np.ones((2, 2)), "tiny": 1e-20 * np.eye(2)}.items():
        parts = (F, H, 0.1 * np.eye(4), R, np.zeros(4), np.eye(4))
        a, b = (_linear(sp.filter, y, m, *parts) for m in (sp.srekf(), sp.iterated(method, 3)))
        np.testing.assert_allclose(b.mean, a.mean, rtol=1e-9, atol=1e-9, err_msg=name)
        np.testing.assert_allclose(b.std, a.std, rtol=1e-6, atol=1e-7, err_msg=name)


@pytest.mark.parametrize("method", METHODS[:5], ids=str)
def test_a_variance_that_overflows_is_not_a_certainty(method):
    parts = ([[1e100]], [[1.0]], [[1.0]], [[1.0]], np.zeros(1), np.eye(1))
    with pytest.warns(BreakdownWarning, match="estimates are not finite"):
        std = np.asarray(_linear(sp.filter, np.full((6, 1), np.nan), method, *parts).std[:, 0])
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


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_sensors_that_agree_under_a_wide_prior_in_32_bits(method):
    """After the first of two equal sensors, what the second adds is small beside the prior, but not nothing."""
    f32 = lambda a: jnp.asarray(a, jnp.float32)  # noqa: E731
    P0, H = 1e6 * np.array([[1, 0.9], [0.9, 1]]), [[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
    parts = (f32(np.eye(2)), f32(H), f32(np.eye(2)), f32(0.5 * np.eye(3)), f32(np.zeros(2)), f32(P0))
    post = _linear(sp.filter, f32([[1000.0, 1000.5, 1400.0]]), method, *parts)
    np.testing.assert_allclose(post.mean[0], [1000.25, 1400.0], rtol=3e-6)
    np.testing.assert_allclose(post.std[0], [0.5, 0.5**0.5], rtol=1e-5)


@pytest.mark.parametrize("scale", [1.0, 1e8])
@pytest.mark.parametrize("method", METHODS, ids=str)
def test_copies_of_exact_sensors_in_other_units_change_nothing(method, scale):
    H = np.array([[1.0, 2.0, 3.0], [2.0, 4.0, 6.0], [0.5, 1.0, 1.5], [0.2, 1.0, 0.4]])
    H[:3] *= scale
    y = np.array([[1.7 * scale, 3.4 * scale, 0.85 * scale, -0.3]])
    F, Q, start = np.eye(3), np.eye(3), (np.zeros(3), np.diag([400.0, 225.0, 900.0]))
    a = _linear(sp.filter, y, method, F, H, Q, np.diag([0.0, 0.0, 0.0, 1e-4]), *start)
    b = _linear(sp.filter, y[:, [0, 3]], method, F, H[[0, 3]], Q, np.diag([0.0, 1e-4]), *start)
    np.testing.assert_allclose(a.mean, b.mean, rtol=1e-8)
    np.testing.assert_allclose(a.std, b.std, rtol=1e-8)


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_an_exact_measurement_repeated_says_nothing_new(method):
    H, P0 = np.array([[1.0, 2.0, 3.0]]), np.array([[2.0, 0.3, 0.1], [0.3, 1.0, 0.2], [0.1, 0.2, 3.0]])
    y = np.full((6, 1), 2.0)
    post = _linear(sp.filter, y, method, np.eye(3), H, np.zeros((3, 3)), np.zeros((1, 1)), np.zeros(3), P0)
    np.testing.assert_allclose(post.mean, np.broadcast_to(post.mean[:1], (6, 3)), rtol=1e-9)
    np.testing.assert_allclose(post.std, np.broadcast_to(post.std[:1], (6, 3)), rtol=1e-9)
    K = P0 @ H.T / (H @ P0 @ H.T)
    np.testing.assert_allclose(post.mean[0], 2.0 * K[:, 0], rtol=1e-12)
    np.testing.assert_allclose(post.std[0], np.sqrt(np.diag(P0 - K @ H @ P0)), rtol=1e-9)
    assert np.all(post.nis[1:] == 0)


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_an_exact_constraint_between_states_is_imposed_once(method):
    """x₁ − x₂ = 0 whatever the size of the states: what is left of their difference is round-off, not information."""
    P0, m0 = np.array([[1.0, 0.5], [0.5, 2.0]]), np.array([5e3, 5e3 + 2])
    parts = (np.eye(2), np.array([[1.0, -1.0]]), np.zeros((2, 2)), np.zeros((1, 1)), m0, P0)
    post = _linear(sp.filter, np.zeros((6, 1)), method, *parts)
    K = P0 @ [1.0, -1.0] / 2.0
    std = np.sqrt(np.diag(P0 - np.outer(K, [1.0, -1.0] @ P0)))
    np.testing.assert_allclose(post.mean, np.broadcast_to(m0 + 2 * K, (6, 2)), rtol=1e-12)
    np.testing.assert_allclose(post.std, np.broadcast_to(std, (6, 2)), rtol=1e-9)
    assert np.all(post.nis[1:] == 0)


@pytest.mark.parametrize(("n", "rank", "spare"), [(5, 3, 2), (8, 4, 0), (12, 4, 8), (25, 9, 16)])
def test_triangularisation_of_fewer_independent_columns_than_rows(n, rank, spare):
    """Rows that depend on those before leave round-off, which has no direction that later rows could be split along."""
    for seed in range(5):
        r = np.random.default_rng([n, seed])
        A = np.concatenate([r.normal(size=(n, rank)), np.zeros((n, spare))], axis=1)
        L = tria(jnp.asarray(A))
        np.testing.assert_allclose(L @ L.T, A @ A.T, atol=1e-13 * n)


def test_states_that_start_with_few_independent_errors():
    r = np.random.default_rng(0)
    n, P0 = 12, np.diag([1.0] * 4 + [0.0] * 8)
    F, H = 0.5 * r.normal(size=(n, n)), np.eye(n)[:1]
    y = r.normal(size=(4, 1))
    parts = (F, H, np.zeros((n, n)), np.eye(1), np.zeros(n), P0)
    a, b = (_linear(sp.filter, y, method, *parts) for method in (sp.srcdkf(), sp.ekf()))
    np.testing.assert_allclose(a.cov, b.cov, atol=1e-10 * np.abs(b.cov).max())
    np.testing.assert_allclose(a.mean, b.mean, atol=1e-9 * np.abs(b.mean).max())


def test_a_small_noise_beside_a_large_common_error_is_not_lost():
    """Two sensors share a strong nonlinearity; their difference tells x, as precisely as their noise and no more."""

    def model(noise):
        return sp.StateSpaceModel(
            lambda x, u: x,
            lambda x, u: jnp.stack([1e6 * x[0] ** 2, 1e6 * x[0] ** 2 + x[0]]),
            np.zeros((1, 1)),
            noise * np.eye(2),
            sp.Gaussian(np.zeros(1), np.eye(1)),
        )

    y = np.array([[1e6, 1e6 + 1]])
    for noise in (1e-4, 1e-6):
        exact = np.sqrt(2 * noise)
        root, dense = (float(sp.filter(model(noise), y, None, method).std[0, 0]) for method in (sp.srukf(), sp.ukf()))
        np.testing.assert_allclose(root, exact, rtol=1e-2)
        assert 0.7 * exact < dense < 1.5 * exact
