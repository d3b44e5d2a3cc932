"""A model of one state whose belief has two modes, and its exact answer on a grid.

A level that grows where it is, seen through its square: the growth model (Kitagawa 1987) with a milder drift.
"""

import jax.numpy as jnp
import numpy as np
from oracles.point_mass import point_mass

import sigmapoint as sp

Q, R, P0 = 1.0, 0.5, 4.0
Y = np.array([1.0, 3.0, np.nan, 2.5, 6.0, 4.0, 0.3, 2.0])
U = np.cos(1.2 * np.arange(len(Y)))[:, None]


def normal(variance, mean=0.0):
    return lambda v: np.exp(-((v - mean) ** 2) / (2 * variance)) / np.sqrt(2 * np.pi * variance)


MODEL = sp.StateSpaceModel(
    lambda x, u: 0.7 * x + 4 * x / (1 + x**2) + 0.3 * u,
    lambda x, u: x**2 / 4,
    Q * jnp.eye(1),
    R * jnp.eye(1),
    sp.Gaussian(0.5 * jnp.ones(1), P0 * jnp.eye(1)),
)
EXACT = point_mass(
    lambda x, k: 0.7 * x + 4 * x / (1 + x**2) + 0.3 * U[k, 0],
    lambda x: x**2 / 4,
    normal(Q),
    normal(R),
    normal(P0, 0.5),
    Y,
    -15.0,
    15.0,
    2001,
)
