"""Random linear models with inputs, missing elements and time-varying noise, and their exact answers."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from oracles.kalman import kalman_filter, rts_smoother

import sigmapoint as sp


class LinearCase(NamedTuple):
    model: sp.StateSpaceModel
    y: np.ndarray
    u: dict
    filtered: object
    smoothed: object


def case(n: int, seed: int = 0, T: int = 12) -> LinearCase:
    """A random stable model with n states; F, H and the offsets change with time and come in through `u`."""
    r = np.random.default_rng([n, seed])
    m = r.integers(1, n + 1)
    F = 0.9 * np.eye(n) + 0.3 * r.normal(size=(T, n, n)) / np.sqrt(n)
    H, b, d = r.normal(size=(T, m, n)), r.normal(size=(T, n)), r.normal(size=(T, m))
    Q, R = _covariances(r, T, n), _covariances(r, T, m)
    m0, P0 = r.normal(size=n), _covariances(r, 1, n)[0]
    y = r.normal(size=(T, m))
    y[r.random(y.shape) < 0.25] = np.nan
    y[T // 2] = np.nan
    model = sp.StateSpaceModel(
        dynamics=lambda x, u: u["F"] @ x + u["b"],
        observation=lambda x, u: u["H"] @ x + u["d"],
        process_noise=Q,
        observation_noise=R,
        initial=sp.Gaussian(m0, P0),
    )
    filtered = kalman_filter(F, b, Q, H, d, R, m0, P0, y)
    u = {"F": jnp.asarray(F), "b": jnp.asarray(b), "H": jnp.asarray(H), "d": jnp.asarray(d)}
    return LinearCase(model, y, u, filtered, rts_smoother(F, Q, filtered))


def _covariances(r: np.random.Generator, T: int, n: int) -> np.ndarray:
    A = r.normal(size=(T, n, n))
    return A @ A.transpose(0, 2, 1) / n + 0.2 * np.eye(n)
