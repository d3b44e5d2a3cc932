"""Every form of the small linear algebra gives the same answers: the laws again with the native ones forced on."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from laws import ill_conditioned
from laws.table import METHODS
from laws.test_linear import _check

import sigmapoint as sp
from sigmapoint.compiled import folding, native
from sigmapoint.linear_algebra import factors as linalg
from sigmapoint.linear_algebra import triangularization


@pytest.fixture(autouse=True, scope="module")
def _forced():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(native, "NATIVE", True)
        patch.setattr(folding, "NATIVE", True)
        jax.clear_caches()  # what was compiled before has the other forms
        yield
    jax.clear_caches()


@pytest.mark.parametrize("n", [1, 2, 5, 8, 9, 13, 24, 25, 40])
def test_factorisations(n):
    r = np.random.default_rng(n)
    A = r.normal(size=(n, 2 * n + 1))
    P = A @ A.T
    S, b = np.linalg.cholesky(P), r.normal(size=(n, 3))

    @jax.jit
    def found(A, P, S, b):
        solved = linalg.solve_lower(S, b), linalg.solve_upper(S, b)
        return linalg.cholesky(P), triangularization.tria(A), *solved, native.product(A, A.T)

    root, triangle, lower, upper, square = found(A, P, S, b)
    np.testing.assert_allclose(root, S, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(triangle, S, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(lower, np.linalg.solve(S, b), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(upper, np.linalg.solve(S.T, b), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(square, P, rtol=1e-12)


@pytest.mark.parametrize("n", [3, 9, 26])
def test_singular_matrices_have_the_factor_that_cholesky_gives(n):
    """A row that repeats another, and one without variance, leave columns of zeros in every form."""
    r = np.random.default_rng(n)
    A = r.normal(size=(n, n + 2))
    A[n - 1] = 0
    L = triangularization.tria(jnp.asarray(A))
    np.testing.assert_allclose(L @ L.T, A @ A.T, atol=1e-13 * n)
    assert (L[:, n - 1] == 0).all()
    P = A @ A.T
    P[1], P[:, 1] = P[0], P[:, 0]
    P[1, 1] = P[0, 0]
    L = linalg.cholesky(jnp.asarray(P))
    np.testing.assert_allclose(L @ L.T, P, atol=1e-12 * n)
    assert (L[:, 1] == 0).all()


@pytest.mark.parametrize("n", [4, 8, 13, 70])
def test_triangular_factors_are_those_of_orthogonal_transformations(n):
    """However ill-conditioned the rows (10 to the power of `spread`), and whatever their units."""
    tria = jax.jit(triangularization.tria)
    for spread in (0, 3, 5, 7, 12):
        r = np.random.default_rng([n, spread])
        sizes = np.diag(10.0 ** -np.linspace(0, spread, n))
        A = np.linalg.qr(r.normal(size=(n, n)))[0] @ sizes @ np.linalg.qr(r.normal(size=(2 * n, n)))[0].T
        units = 10.0 ** r.uniform(-30, 30, size=(n, 1))
        L = tria(jnp.asarray(units * A)) / units
        assert (jnp.triu(L, 1) == 0).all()
        assert (jnp.diagonal(L) > 0).all()
        np.testing.assert_allclose(L @ L.T, A @ A.T, atol=1e-15 * n)
        direct = np.linalg.qr(A.T, mode="r").T
        direct *= np.where(np.diag(direct) < 0, -1, 1)
        np.testing.assert_allclose(L, direct, atol=2e-15 * n * 10**spread)


@pytest.mark.parametrize("n", [2, 9])
def test_derivatives_of_the_triangularisation(n):
    r = np.random.default_rng(n)
    A, dA = r.normal(size=(2, n, 2 * n))
    L, dL = jax.jit(lambda A, dA: jax.jvp(triangularization.tria, (A,), (dA,)))(A, dA)
    np.testing.assert_allclose(dL @ L.T + L @ dL.T, dA @ A.T + A @ dA.T, atol=1e-11)
    assert (jnp.triu(dL, 1) == 0).all()


def test_products_in_a_users_function_become_sums_with_the_same_value_and_derivative():
    r = np.random.default_rng(0)
    A, B, x = jnp.asarray(r.normal(size=(3, 4))), jnp.asarray(r.normal(size=(4, 3))), jnp.asarray(r.normal(size=4))

    def f(x, u):
        return jnp.tanh(A @ x) + (B.T @ x) * (x @ x) + jnp.einsum("ij,i->j", B, x) + (x @ (B @ A)[:, :3])

    g = folding.folded(f)
    assert "dot_general" not in str(jax.make_jaxpr(g)(x, None))
    np.testing.assert_allclose(g(x, None), f(x, None), rtol=1e-14)
    np.testing.assert_allclose(jax.jacfwd(g)(x, None), jax.jacfwd(f)(x, None), rtol=1e-13)
    np.testing.assert_allclose(jax.jacrev(g)(x, None), jax.jacrev(f)(x, None), rtol=1e-13)
    many = jnp.stack([x, 2 * x])
    np.testing.assert_allclose(jax.vmap(lambda x: g(x, None))(many), jax.vmap(lambda x: f(x, None))(many), rtol=1e-14)


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("name", "n"),
    [
        ("sr cdkf", 5),
        ("ekf", 1),
        ("ukf", 2),
        *(pytest.param(name, n, marks=SLOW) for name in ("cdkf", "sr cdkf", "sr augmented") for n in (1, 3, 8, 13)),
    ],
)
def test_linear_models(name, n):
    _check(name, n, iterations=1)


@pytest.mark.parametrize("name", ["sr ekf", "sr cdkf"])
def test_ill_conditioned_models(name):
    for m, coupled in ((1, True), (3, False)):
        case = ill_conditioned.case(m, coupled)
        post = ill_conditioned.filtered(case, METHODS[name], jnp.float64)
        assert ill_conditioned.sound(post)
        assert ill_conditioned.worst(post, case.exact) < 1e-8


def test_gradient_of_the_likelihood():
    y = np.random.default_rng(0).normal(size=(20, 1))

    def likelihood(q):
        model = sp.StateSpaceModel(
            lambda x, u: jnp.stack([x[0] + 0.1 * x[1], x[1] - 0.1 * jnp.sin(x[0])]),
            lambda x, u: x[:1],
            q * jnp.eye(2),
            0.1 * jnp.eye(1),
            sp.Gaussian(jnp.zeros(2), jnp.eye(2)),
        )
        return sp.filter(model, y, method=sp.srcdkf()).log_likelihood

    value, slope, h = jax.jit(likelihood), jax.jit(jax.grad(likelihood)), 1e-6
    for q in (0.02, 1e-3):
        difference = (value(q + h * q) - value(q - h * q)) / (2 * h * q)
        np.testing.assert_allclose(slope(q), difference, rtol=1e-6)


def test_a_step_online_is_one_of_the_filter_and_has_derivatives():
    method = sp.srcdkf()

    def model(q):
        return sp.StateSpaceModel(
            lambda x, u: jnp.stack([x[0] + 0.1 * x[1] + u, x[1] - 0.1 * jnp.sin(x[0])]),
            lambda x, u: x[:1],
            q * jnp.eye(2),
            0.1 * jnp.eye(1),
            sp.Gaussian(jnp.zeros(2), jnp.eye(2)),
        )

    y, u = np.random.default_rng(0).normal(size=(6, 1)), np.linspace(0, 1, 6)
    one = model(0.01)
    live = sp.online(one, method)
    post, state = sp.filter(one, y, u, method), live.prepare(y[0], u[0])
    for k in range(6):
        state, info = live.update(state, y[k], u[k])
        np.testing.assert_allclose(state.mean, post.mean[k], rtol=1e-12)
        np.testing.assert_allclose(state.cov, post.cov[k], rtol=1e-11, atol=1e-15)
        np.testing.assert_allclose(info.nis, post.nis[k], rtol=1e-11)
        state = live.predict(state, u[k])

    def likelihood(q):
        live = sp.online(model(q), method)
        state, first = live.update(live.init(), y[0], u[0])
        return first.log_likelihood + live.update(live.predict(state, u[0]), y[1], u[1])[1].log_likelihood

    value, h = jax.jit(likelihood), 1e-6
    difference = (value(0.01 + h) - value(0.01 - h)) / (2 * h)
    np.testing.assert_allclose(jax.jit(jax.grad(likelihood))(0.01), difference, rtol=1e-6)
    np.testing.assert_allclose(value(0.01), likelihood(0.01), rtol=1e-12)
    many = jax.jit(jax.vmap(likelihood))(jnp.array([0.01, 0.02]))
    np.testing.assert_allclose(many[0], value(0.01), rtol=1e-12)


@pytest.mark.parametrize("in_parallel", [False, True])
def test_one_row_through_posterior_linearization(in_parallel):
    model = sp.StateSpaceModel(
        lambda x, u: 0.9 * x, lambda x, u: x[:1], np.eye(2), np.eye(1), sp.Gaussian(np.zeros(2), np.eye(2))
    )
    found = sp.smooth(model, np.ones((1, 1)), smoother=sp.ipls(2, parallel=in_parallel))
    np.testing.assert_allclose(found.mean, [[0.5, 0.0]], atol=1e-12)
    np.testing.assert_allclose(found.cov, [np.diag([0.5, 1.0])], atol=1e-12)


@pytest.mark.parametrize(
    "smoother",
    [sp.two_filter(), *(pytest.param(s, marks=pytest.mark.slow) for s in (sp.fixed_lag(2), sp.ipls(2)))],
    ids=str,
)
def test_derivatives_of_what_looks_back_are_those_of_finite_differences(smoother):
    def last(q):
        model = sp.StateSpaceModel(
            lambda x, u: jnp.stack([x[0] + 0.1 * x[1], x[1] - q * x[0]]), lambda x, u: x[:1], q * jnp.eye(2),
            jnp.eye(1), sp.Gaussian(jnp.ones(2), jnp.eye(2)),
        )  # fmt: skip
        return (sp.smooth(model, jnp.ones((6, 1)), smoother=smoother).mean ** 2).sum()

    value = jax.jit(last)
    difference = (value(0.3 + 1e-5) - value(0.3 - 1e-5)) / 2e-5
    np.testing.assert_allclose(jax.jit(jax.grad(last))(0.3), difference, rtol=1e-6)
