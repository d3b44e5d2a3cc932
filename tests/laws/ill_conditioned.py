"""P0 = 1e8·I against Q = R = 1e-10·I in six states: eighteen orders of magnitude, and the answer at 60 digits.

The truth starts at zero. That matters: a function value near 1e4 has a rounding error of 1e-12, which is 1e-7 of a
standard deviation of 1e-5, and no filter that works from function values can be better than that.
"""

from functools import cache
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from oracles.high_precision import PreciseResult, precise_kalman_filter

import sigmapoint as sp

N, T = 6, 200
MEASURED = (1, 2, 3)
"""How many of the six states are measured."""


class Case(NamedTuple):
    F: np.ndarray
    H: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    P0: np.ndarray
    y: np.ndarray
    exact: PreciseResult


@cache
def case(m: int, coupled: bool) -> Case:
    """`m` states measured; dynamics that keep every state by itself, or (`coupled`) mix all of them."""
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
    return Case(F, H, Q, R, P0, y, exact)


def _f(x, u):  # one function for every case, so that a method is compiled once for each size
    return u["F"] @ x


def _h(x, u):
    return u["H"] @ x


def filtered(case: Case, method: sp.Method, dtype: Any) -> sp.Posterior:
    """The case in 64-bit or 32-bit numbers."""
    F, H, Q, R, P0, y = (jnp.asarray(a, dtype) for a in case[:6])
    model = sp.StateSpaceModel(_f, _h, Q, R, sp.Gaussian(jnp.zeros(N, dtype), P0))
    u = {"F": jnp.broadcast_to(F, (T, *F.shape)), "H": jnp.broadcast_to(H, (T, *H.shape))}
    return sp.filter(model, y, u, method)


def worst(post: sp.Posterior, exact: PreciseResult) -> float:
    """The largest relative error of a standard deviation."""
    return float(np.max(np.abs(np.asarray(post.std, float) - exact.std) / exact.std))


def sound(post: sp.Posterior) -> bool:
    """Finite, symmetric, no negative variance, and eigenvalues not below the rounding of the stored covariance."""
    cov, eps = np.asarray(post.cov, float), float(jnp.finfo(post.cov.dtype).eps)
    if not (np.isfinite(cov).all() and np.isfinite(np.asarray(post.mean)).all()):
        return False
    largest = np.abs(cov).max(axis=(1, 2))
    return bool(
        (np.einsum("tii->ti", cov) >= 0).all()
        and np.array_equal(cov, np.swapaxes(cov, 1, 2))
        and (np.linalg.eigvalsh(cov).min(axis=1) >= -8 * eps * largest).all()
    )
