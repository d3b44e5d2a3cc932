"""A level with an unknown persistence, and its posterior on a grid by the Kalman filter of the textbook."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from oracles.kalman import kalman_filter

import sigmapoint as sp

THETA = {"a": sp.bounded(0.5, 0.3, low=-1.0, high=1.0)}
Q, R = 0.5, 0.3


def build(theta):
    one = jnp.eye(1)
    start = sp.Gaussian(jnp.zeros(1), one)
    return sp.StateSpaceModel(lambda x, u: theta["a"] * x, lambda x, u: x, Q * one, R * one, start)


Y = sp.simulate(build({"a": 0.8}), 20, key=0)[1]


class Exact(NamedTuple):
    mean: float
    """of z"""
    std: float
    log_evidence: float


def exact(y, theta=THETA):
    """By a sum over a grid of z, which has a standard normal prior."""
    z = np.linspace(-5, 5, 201)
    a = np.asarray(theta["a"].range.value(theta["a"].center, theta["a"].std, jnp.asarray(z)))

    def log_likelihood(a):
        F, Qs, H, Rs = (np.full((len(y), 1, 1), value) for value in (a, Q, 1.0, R))
        zero = np.zeros((len(y), 1))
        return kalman_filter(F, zero, Qs, H, zero, Rs, np.zeros(1), np.eye(1), np.asarray(y)).log_likelihood

    log_density = np.array([log_likelihood(at) for at in a]) - z**2 / 2 - np.log(2 * np.pi) / 2
    weight = np.exp(log_density - log_density.max())
    mean = np.average(z, weights=weight)
    std = np.sqrt(np.average((z - mean) ** 2, weights=weight))
    return Exact(mean, std, log_density.max() + np.log(weight.sum() * (z[1] - z[0])))
