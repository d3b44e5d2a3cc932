"""What holds for every rule, and where rules coincide."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from laws.table import DENSE

from sigmapoint.rules.central import CentralDifference
from sigmapoint.rules.cubature import Cubature
from sigmapoint.rules.hermite import GaussHermite
from sigmapoint.rules.linearization import SigmaPointRule
from sigmapoint.rules.point_sets import from_weights
from sigmapoint.rules.simplex import Simplex
from sigmapoint.rules.taylor import Taylor
from sigmapoint.rules.unscented import Julier, Unscented
from sigmapoint.spaces import Euclidean

IN_USE = dict.fromkeys(method.rule for method in DENSE.values() if isinstance(method.rule, SigmaPointRule))
OTHER_SETTINGS = [Simplex(1.0, 1.0, 0.4), Simplex(0.1, 2.0, 0.4), GaussHermite(2), GaussHermite(4)]
RULES = [*IN_USE, *OTHER_SETTINGS]


def _moments(rule, g, n):
    lin = rule(g, jnp.eye(n), Euclidean())
    return lin.mean, lin.slope @ lin.slope.T + lin.residual @ lin.residual.T, lin.slope


@pytest.mark.parametrize("rule", RULES, ids=str)
@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_points_have_mean_zero_and_unit_covariance_and_rows_ignore_constants(rule, n):
    c = rule.sigma_points(n)
    assert (c.points[0] == 0).all()
    np.testing.assert_allclose(c.mean.sum(), 1, atol=1e-9)
    size = np.abs(c.slope).max()
    np.testing.assert_allclose(c.slope @ c.points, np.eye(n), atol=1e-12 * size)
    np.testing.assert_allclose(c.residual @ c.points, 0, atol=1e-12 * max(1, np.abs(c.residual).max(initial=0)))
    np.testing.assert_allclose(c.mean @ c.points, 0, atol=1e-12 * np.abs(c.mean).max())
    for rows in (c.slope, c.residual):
        np.testing.assert_allclose(rows.sum(axis=1), 0, atol=1e-9 * max(1, np.abs(rows).max(initial=0)))


@pytest.mark.parametrize("rule", [*RULES, Taylor()], ids=str)
def test_affine_functions_are_exact(rule):
    A = np.random.default_rng(0).normal(size=(2, 3))
    mean, cov, slope = _moments(rule, lambda xi: jnp.asarray(A) @ xi + 1.0, 3)
    np.testing.assert_allclose(mean, 1, atol=1e-9)
    np.testing.assert_allclose(cov, A @ A.T, atol=1e-9)
    np.testing.assert_allclose(slope, A, atol=1e-9)


def test_in_one_dimension_hermite_order_3_is_unscented_1_0_2_and_has_the_mean_of_central_differences():
    def g(xi):
        return jnp.sin(1 + xi) + xi**2

    mean, cov, slope = _moments(GaussHermite(3), g, 1)
    for other in (Unscented(1.0, 0.0, 2.0), CentralDifference(3**0.5)):
        got = _moments(other, g, 1)
        np.testing.assert_allclose(got[0], mean, rtol=1e-13)
        np.testing.assert_allclose(got[2], slope, rtol=1e-13)
    np.testing.assert_allclose(_moments(Unscented(1.0, 0.0, 2.0), g, 1)[1], cov, rtol=1e-13)


def test_unscented_1_0_0_is_cubature():
    a, b = Unscented(1.0, 0.0, 0.0).sigma_points(4), Cubature().sigma_points(4)
    for x, y in zip(a, b):
        np.testing.assert_array_equal(x, y)
    assert b.mean[0] == 0
    assert len(np.unique(b.mean[1:])) == 1


@pytest.mark.parametrize("n", [1, 2, 5])
def test_the_spherical_simplex_is_a_regular_one_and_its_mirror_image_and_sees_products_of_states(n):
    c = DENSE["ssckf"].rule.sigma_points(n)
    vertices, mirrored = np.split(c.points[1:], 2)
    np.testing.assert_array_equal(vertices, -mirrored)
    np.testing.assert_allclose(vertices @ vertices.T, (n + 1) * np.eye(n + 1) - 1, atol=1e-14 * n)
    np.testing.assert_allclose(c.mean[1:], 0.5 / (n + 1), rtol=1e-15)
    assert ((c.mean * c.points.T**2) @ c.points**2 > 0.9 / n).all()


@pytest.mark.parametrize("n", [1, 2, 4])
def test_central_differences_give_exact_covariances_for_sums_of_squares(n):
    a = np.arange(1.0, n + 1)
    mean, cov, _ = _moments(CentralDifference(3**0.5), lambda xi: jnp.sum(jnp.asarray(a) * xi**2)[None], n)
    np.testing.assert_allclose(mean[0], a.sum(), rtol=1e-13)
    np.testing.assert_allclose(cov[0, 0], 2 * (a**2).sum(), rtol=1e-13)


def test_weighted_formula_of_the_unscented_transform():
    """Against eqs 7.32-7.34 summed as they stand."""
    n, (alpha, beta, kappa) = 3, (0.7, 1.5, 0.4)
    lam = alpha**2 * (n + kappa) - n
    g = jax.vmap(lambda xi: jnp.stack([jnp.sin(xi[0]) * xi[1], jnp.exp(0.3 * xi[2])]))
    points = np.sqrt(n + lam) * np.concatenate([np.zeros((1, n)), np.eye(n), -np.eye(n)])
    w = np.full(2 * n + 1, 0.5 / (n + lam))
    w[0] = lam / (n + lam)
    wc = w.copy()
    wc[0] += 1 - alpha**2 + beta
    Y = np.asarray(g(jnp.asarray(points)))
    mean = w @ Y
    cov = (Y - mean).T @ (wc[:, None] * (Y - mean))
    got = _moments(Unscented(alpha, beta, kappa), lambda xi: g(xi[None])[0], n)
    np.testing.assert_allclose(got[0], mean, rtol=1e-12)
    np.testing.assert_allclose(got[1], cov, rtol=1e-12)


def test_a_negative_centre_weight_gives_the_weighted_covariance_and_that_is_positive_semi_definite():
    """Eq. 7.34 summed as it stands, for random spreads, dimensions and values, with centre weights down to −1e6.

    Eq. 7.34 adds terms of both signs, so the difference is held against the sum of their sizes.
    """
    r = np.random.default_rng(0)
    negative = 0
    for _ in range(100):
        n, alpha = int(r.integers(1, 9)), 10 ** r.uniform(-3, 0)
        beta, kappa = alpha**2 + r.exponential(), r.uniform(-0.9 * n, 3)
        c = Unscented(alpha, beta, kappa).sigma_points(n)
        negative += c.mean[0] < 0
        values = r.normal(size=(100, len(c.points), 3)) * 10 ** r.uniform(-3, 3, size=(100, 1, 1))
        phi, E = c.slope @ values, c.residual @ values
        cov = np.einsum("bni,bnj->bij", phi, phi) + np.einsum("bni,bnj->bij", E, E)
        w = c.mean.copy()
        w[0] += 1 - alpha**2 + beta
        d = values - (c.mean @ values)[:, None, :]
        scale = np.einsum("p,bpi,bpi->b", np.abs(w), d, d)
        difference = cov - np.einsum("p,bpi,bpj->bij", w, d, d)
        assert (np.abs(difference) <= 1e-14 * scale[:, None, None]).all()
        assert (np.linalg.eigvalsh(cov) >= -1e-13 * np.trace(cov, axis1=1, axis2=2)[:, None]).all()
    assert negative > 50


@settings(max_examples=60, deadline=None)
@given(n=st.integers(1, 6), order=st.integers(2, 4), seed=st.integers(0, 10**6))
def test_any_positive_set_reproduces_its_own_weighted_covariance(n, order, seed):
    if order**n > 300:
        n = 3
    c = GaussHermite(order).sigma_points(n)
    Y = np.random.default_rng(seed).normal(size=(len(c.points), 2))
    w = c.mean
    mean = w @ Y
    np.testing.assert_allclose(
        (c.slope @ Y).T @ (c.slope @ Y) + (c.residual @ Y).T @ (c.residual @ Y),
        (Y - mean).T @ (w[:, None] * (Y - mean)),
        atol=1e-10,
    )


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: Unscented(0.0, 2.0, 0.0), "alpha"),
        (lambda: Unscented(float("nan"), 2.0, 0.0), "alpha"),
        (lambda: Unscented(0.1, -0.5, 0.0), "beta >= alpha"),
        (lambda: Unscented(1.0, 0.0, -2.0).sigma_points(2), "kappa"),
        (lambda: Unscented(1.0, 0.0, -1.0).sigma_points(3), "beta"),
        (lambda: Julier(1.0), "w0"),
        (lambda: Julier(-0.5), "w0"),
        (lambda: Simplex(1.0, 1.0, -0.1), "w0"),
        (lambda: Simplex(0.1, -9.0, 0.4).sigma_points(2), "beta"),
        (lambda: CentralDifference(0.9), "h"),
        (lambda: GaussHermite(1), "order"),
        (lambda: GaussHermite(3).sigma_points(10), "points"),
        (lambda: from_weights(np.zeros((2, 1)), np.array([0.0, 1.0]), -5.0), "beta"),
    ],
)
def test_settings_that_do_not_work_are_refused_with_the_ones_that_do(make, word):
    with pytest.raises(ValueError, match=word):
        make()


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
@pytest.mark.parametrize("rule", RULES, ids=str)
def test_a_straight_function_of_large_values_has_no_residual_and_a_bend_above_round_off_has(rule, dtype):
    n, size = 3, 1e4
    A = jnp.asarray(np.random.default_rng(5).normal(size=(n, n)), dtype)
    factor = size * jnp.eye(n, dtype=dtype)

    @jax.jit
    def residual(bend):
        return rule(lambda x: A @ x + 30.0 + bend * (A @ x) ** 2, factor, Euclidean()).bend

    assert (residual(jnp.zeros((), dtype)) == 0).all()
    seen = rule.sigma_points(n).residual.size > 0 and not isinstance(rule, Cubature)
    if seen:
        spread = float(np.abs(rule.sigma_points(n).points).max())
        bent = 1e4 * float(jnp.finfo(dtype).eps) / size / spread**2  # 1e4 round-offs at the outermost point
        one, two = (jnp.linalg.norm(residual(jnp.asarray(b, dtype)), axis=1) for b in (bent, 2 * bent))
        np.testing.assert_allclose(two, 2 * one, rtol=0.05)
    # The derivative does not see the threshold: at no bend at all, it is that of the residual itself.
    slope = jax.jit(jax.jacfwd(residual))(jnp.zeros((), dtype))
    far = residual(jnp.asarray(1.0, dtype)) - residual(jnp.asarray(0.5, dtype))
    np.testing.assert_allclose(2 * far, slope, rtol=1e-4, atol=1e-4 * float(jnp.abs(slope).max()))
