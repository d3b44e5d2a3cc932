"""On a linear model every method is the Kalman filter and the Rauch-Tung-Striebel smoother."""

import numpy as np
import pytest
from laws.linear import case
from laws.table import LARGEST, METHODS, precision

import sigmapoint as sp

# Every method in a small, a middle and (for the recommended rules) the largest dimension; the whole table is `slow`.
QUICK = {
    "cdkf": (1, 7),
    "sr cdkf": (1, 12),
    "sr ekf": (6,),
    "sr ukf": (4,),
    "augmented": (3,),
    "sr augmented": (2,),
}


def _check(name: str, n: int, iterations: int) -> None:
    model, y, u, filtered, smoothed = case(n)
    method = METHODS[name]
    if iterations > 1:
        method = sp.iterated(method, iterations)
    post, back = sp.filter(model, y, u, method), sp.smooth(model, y, u, method)
    rtol = precision(name)
    np.testing.assert_allclose(post.mean, filtered.mean, rtol=rtol, atol=10 * rtol)
    np.testing.assert_allclose(post.cov, filtered.cov, rtol=rtol, atol=10 * rtol)
    np.testing.assert_allclose(post.innovation, filtered.innovation, rtol=rtol, atol=10 * rtol)
    np.testing.assert_allclose(post.innovation_cov, filtered.innovation_cov, rtol=rtol, atol=10 * rtol)
    np.testing.assert_allclose(post.nis, filtered.nis, rtol=rtol, atol=10 * rtol)
    np.testing.assert_allclose(post.log_likelihood, filtered.log_likelihood, rtol=rtol)
    np.testing.assert_allclose(back.mean, smoothed.mean, rtol=rtol, atol=10 * rtol)
    np.testing.assert_allclose(back.cov, smoothed.cov, rtol=rtol, atol=10 * rtol)


@pytest.mark.parametrize("name", METHODS)
def test_every_method_is_the_kalman_filter_and_smoother(name):
    for n in QUICK.get(name, (2,)):
        _check(name, n, iterations=1)


@pytest.mark.parametrize(
    ("name", "iterations"),
    [
        pytest.param("ekf", 2, marks=pytest.mark.slow),
        ("sr ekf", 5),
        ("ukf", 3),
        ("sr cdkf", 4),
        pytest.param("sr simplex_ukf", 2, marks=pytest.mark.slow),
    ],
)
def test_iterating_an_update_counts_the_measurement_once(name, iterations):
    _check(name, 3, iterations)


@pytest.mark.slow
@pytest.mark.parametrize("n", range(1, 13))
@pytest.mark.parametrize("name", METHODS)
def test_every_method_in_every_dimension(name, n):
    if n > LARGEST.get(name, 12):
        pytest.skip(f"{name} has 3**{n} points")
    _check(name, n, iterations=1)


@pytest.mark.slow
@pytest.mark.parametrize("iterations", range(1, 6))
@pytest.mark.parametrize("name", [name for name in METHODS if "augmented" not in name and "extended" not in name])
def test_every_method_iterated(name, iterations):
    _check(name, 5 if name not in LARGEST else 3, iterations)
