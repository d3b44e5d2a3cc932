"""P0 = 1e8·I against Q = R = 1e-10·I in six states: eighteen orders of magnitude, held against 60-digit arithmetic.

The truth starts at zero. That matters: a function value near 1e4 has a rounding error of 1e-12, which is 1e-7 of a
standard deviation of 1e-5, and no filter that works from function values can be better than that.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from laws.table import DENSE, SQUARE_ROOT
from oracles.high_precision import precise_kalman_filter

import sigmapoint as sp

N, T = 6, 200


def _case(m: int, coupled: bool):
    r = np.random.default_rng([m, coupled])
    F = np.eye(N)
    if coupled:
        F = F + 0.1 * r.normal(size=(N, N))
        F /= np.abs(np.linalg.eigvals(F)).max()
    H = np.eye(N)[:: N // m][:m]
    Q, R, P0 = 1e-10 * np.eye(N), 1e-10 * np.eye(m), 1e8 * np.eye(N)
    x, y = np.zeros(N), np.empty((T, m))
    for k in range(T):
        y[k] = H @ x + 1e-5 * r.normal(size=m)
        x = F @ x + 1e-5 * r.normal(size=N)
    exact = precise_kalman_filter(F, np.zeros(N), Q, H, np.zeros(m), R, np.zeros(N), P0, y)
    return F, H, Q, R, P0, y, exact


CASES = {(m, coupled): _case(m, coupled) for m in (1, 2, 3) for coupled in (False, True)}


def _f(x, u):  # one function for every case, so that a method is compiled once for each size
    return u["F"] @ x


def _h(x, u):
    return u["H"] @ x


def _run(case, method, dtype):
    F, H, Q, R, P0, y, exact = case
    F, H, Q, R, P0, y = (jnp.asarray(a, dtype) for a in (F, H, Q, R, P0, y))
    initial = sp.Gaussian(jnp.zeros(N, dtype), P0)
    model = sp.StateSpaceModel(_f, _h, Q, R, initial)
    u = {"F": jnp.broadcast_to(F, (T, *F.shape)), "H": jnp.broadcast_to(H, (T, *H.shape))}
    post = sp.filter(model, y, u, method)
    worst = np.max(np.abs(np.asarray(post.std, float) - exact.std) / exact.std)
    return post, worst


def _sound(post, dtype):
    """Finite, no negative variance, and eigenvalues not below the rounding of the stored covariance."""
    cov = np.asarray(post.cov, float)
    assert np.isfinite(cov).all()
    assert np.isfinite(np.asarray(post.mean)).all()
    assert (np.einsum("tii->ti", cov) >= 0).all()
    np.testing.assert_array_equal(cov, np.swapaxes(cov, 1, 2))
    largest = np.abs(cov).max(axis=(1, 2))
    assert (np.linalg.eigvalsh(cov).min(axis=1) >= -8 * float(jnp.finfo(dtype).eps) * largest).all()


# 729 points of a product rule take long; sets whose points mix the columns of the factor lose a digit (see below).
STANDARD = [n for n in SQUARE_ROOT if "ghkf" not in n]


@pytest.mark.parametrize("m", [1, 2, 3])
@pytest.mark.parametrize("name", STANDARD)
def test_square_root_forms_agree_with_sixty_digits(name, m):
    for coupled in (False, True):
        post, worst = _run(CASES[m, coupled], SQUARE_ROOT[name], jnp.float64)
        _sound(post, jnp.float64)
        assert worst < (1e-5 if "1e-3" in name else 1e-8), coupled


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=str)
def test_square_root_gauss_hermite_agrees_with_sixty_digits(case):
    post, worst = _run(CASES[case], SQUARE_ROOT["sr ghkf"], jnp.float64)
    _sound(post, jnp.float64)
    assert worst < 1e-8


@pytest.mark.parametrize("name", ["sr ekf", "sr ukf", "sr cdkf"])
def test_iterated_square_root_forms_agree_with_sixty_digits(name):
    for case in ((1, True), (3, False)):
        post, worst = _run(CASES[case], sp.iterated(SQUARE_ROOT[name], 3), jnp.float64)
        _sound(post, jnp.float64)
        assert worst < 1e-8


@pytest.mark.parametrize("name", [n for n in DENSE if "ghkf" not in n])
def test_dense_forms_lose_accuracy_but_never_soundness(name):
    for case in ((1, True), (1, False)):
        post, _ = _run(CASES[case], DENSE[name], jnp.float64)
        _sound(post, jnp.float64)


@pytest.mark.parametrize("m", [1, pytest.param(2, marks=pytest.mark.slow), pytest.param(3, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", STANDARD)
def test_float32_square_root_forms_stay_sound(name, m):
    for coupled in (False, True):
        post, _ = _run(CASES[m, coupled], SQUARE_ROOT[name], jnp.float32)
        assert post.mean.dtype == jnp.float32
        _sound(post, jnp.float32)


@pytest.mark.parametrize("name", ["sr ekf", "sr ukf", "sr ukf(1,0,2)", "sr julier", "sr cdkf", "sr ckf"])
def test_float32_square_root_forms_are_accurate_where_three_elements_are_measured(name):
    _, worst = _run(CASES[3, False], SQUARE_ROOT[name], jnp.float32)
    assert worst < 1e-3
