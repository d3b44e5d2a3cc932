"""A multilayer perceptron: tanh in the hidden layers, linear at the end; its parameters are a list of pairs.

Started as by LeCun et al., "Efficient BackProp" (1998): weights of variance 1 / (inputs of the unit), biases zero.
"""

import itertools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

Parameters = list[tuple[Float[Array, "out in"], Float[Array, " out"]]]


def started(sizes: Sequence[int], key: Array) -> Parameters:
    """Random parameters of a network with so many units in each layer, inputs first."""
    keys = jax.random.split(key, len(sizes) - 1)
    return [
        (jax.random.normal(k, (after, before)) / before**0.5, jnp.zeros(after))
        for k, (before, after) in zip(keys, itertools.pairwise(sizes))
    ]


def starts(sizes: Sequence[int], runs: int, key: Array) -> Float[Array, "R L"]:
    """Random parameters for every run, each in one vector."""
    return jnp.stack([ravel_pytree(started(sizes, k))[0] for k in jax.random.split(key, runs)])


def network(w: Parameters, x: Float[Array, " in"]) -> Float[Array, " out"]:
    """Its outputs [the units of the targets] for one input [its units]."""
    *hidden, (A, b) = w
    for weights, bias in hidden:
        x = jnp.tanh(weights @ x + bias)
    return A @ x + b
