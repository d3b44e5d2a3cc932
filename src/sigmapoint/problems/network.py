"""A multilayer perceptron: tanh in the hidden layers, linear at the end; its parameters are a list of pairs.

Started as by LeCun et al., "Efficient BackProp" (1998): weights of variance 1 / (inputs of the unit), biases zero.
"""

import itertools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Parameters = list[tuple[Float[Array, "out in"], Float[Array, " out"]]]


def started(sizes: Sequence[int], key: Array) -> Parameters:
    """Random parameters of a network with so many units in each layer, inputs first."""
    keys = jax.random.split(key, len(sizes) - 1)
    return [
        (jax.random.normal(k, (after, before)) / before**0.5, jnp.zeros(after))
        for k, (before, after) in zip(keys, itertools.pairwise(sizes))
    ]


def network(w: Parameters, x: Float[Array, " in"]) -> Float[Array, " out"]:
    """Its outputs [the units of the targets] for one input [its units]."""
    *hidden, (A, b) = w
    for weights, bias in hidden:
        x = jnp.tanh(weights @ x + bias)
    return A @ x + b
