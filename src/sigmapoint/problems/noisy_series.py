"""A scalar series seen through noise: x[k] = g(x[k−1], …, x[k−p]) + v, y[k] = x[k] + n, with a network for g.

The state is (x[k], …, x[k−p+1]), newest first; only its first element is measured. Source: Wan & van der Merwe (2001),
equations 7.70 and 7.71, Figure 7.7. Backward in time the network b of the same kind gives what falls out of the state:
x[k−p] from (x[k−p+1], …, x[k]).

`drawn` is the paper's "chaotic autoregressive neural network": a 5-3-1 network with random weights, driven by noise.
Its weights are not given; here they are normal, and networks are drawn until one has a Lyapunov exponent above LEAST
without noise, about one in twenty.
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

import sigmapoint as sp
from sigmapoint.problems.autoregression import pairs
from sigmapoint.problems.network import Parameters, network, started
from sigmapoint.smoothing.smoother import Smoother

NOISE = 10**-0.3
"""Variance of the measurement noise, at 3 dB, of a series of variance 1."""
ORDER, UNITS = 5, 3
GAIN, DRIVE = 4.0, 0.05
"""Of random weights; the standard deviation of the noise that drives the series, whose own is near 1."""
LEAST = 0.05
"""Lyapunov exponent, per sample."""
SETTLED = 200
"""Samples before a series begins."""


class Forward(eqx.Module):
    """The state one sample on."""

    weights: Parameters

    def __call__(self, x: Float[Array, " p"], u: None) -> Float[Array, " p"]:
        return jnp.concatenate([network(self.weights, x), x[:-1]])


class Backward(eqx.Module):
    """The state one sample before."""

    weights: Parameters

    def __call__(self, x: Float[Array, " p"], u: None) -> Float[Array, " p"]:
        return jnp.concatenate([x[1:], network(self.weights, x[::-1])])


def first(x: Float[Array, " p"], u: None) -> Float[Array, " 1"]:
    """What is measured."""
    return x[:1]


def model(
    weights: Parameters, process: Float[Array, ""], noise: Float[Array, ""], initial: sp.Gaussian
) -> sp.StateSpaceModel:
    """With variances of the process noise and of the measurement noise."""
    p = initial.mean.shape[0]
    Q = jnp.zeros((p, p)).at[0, 0].set(process)
    return sp.StateSpaceModel(Forward(weights), first, Q, noise * jnp.eye(1), initial)


def backward(weights: Parameters, process: Float[Array, ""], initial: sp.Gaussian) -> Smoother:
    """The two-filter smoother with this network backward."""
    p = initial.mean.shape[0]
    return sp.two_filter(Backward(weights), noise=jnp.zeros((p, p)).at[-1, -1].set(process), initial=initial)


class Learned(NamedTuple):
    """A network that predicts the next sample."""

    weights: Parameters
    left: Float[Array, ""]
    """variance of what it leaves unpredicted"""


def learned(
    sizes: tuple[int, int, int], clean: Float[Array, " T"], epochs: int, key: Array, prior_std: float = 0.5
) -> Learned:
    """A network trained on a clean series by the square-root filter of the library, in annealed noise."""
    x, d = pairs(clean, sizes[0])
    weights = sp.learn(
        network, started(sizes, key), x, d,
        noise=1e-3, drift=sp.annealed(1e-4, 0.999, 1e-9), prior_std=prior_std, epochs=epochs, key=key,
    ).params  # fmt: skip
    return Learned(weights, jnp.mean((jax.vmap(lambda x: network(weights, x))(x) - d) ** 2))


def stationary(series: Float[Array, " T"], order: int) -> sp.Gaussian:
    """Mean and covariance of the state wherever in the series."""
    T = series.shape[0]
    lags = jnp.stack([series[order - 1 - lag : T - lag] for lag in range(order)])
    return sp.Gaussian(lags.mean(1), jnp.cov(lags))


@partial(jax.jit, static_argnames="samples")
def drawn(samples: int, key: Array) -> Float[Array, " T"]:
    """A series of a chaotic network of its own."""
    weights, for_noise = weights_of(key), jax.random.split(key)[1]

    def step(x: Array, v: Array) -> tuple[Array, Array]:
        x = Forward(weights)(x, None).at[0].add(DRIVE * v)
        return x, x[0]

    noise = jax.random.normal(for_noise, (SETTLED + samples,))
    return jax.lax.scan(step, jnp.zeros(ORDER), noise)[1][SETTLED:]


def weights_of(key: Array) -> Parameters:
    """The network of the series that this key draws."""
    return chaotic(jax.random.split(key)[0])


def rescaled(weights: Parameters, mean: Float[Array, ""], std: Float[Array, ""]) -> Parameters:
    """The same network for the series less its mean, over its standard deviation."""
    (hidden, bias), *inner, (out, offset) = weights
    return [(hidden * std, bias + hidden.sum(1) * mean), *inner, (out / std, (offset - mean) / std)]


def chaotic(key: Array) -> Parameters:
    """Weights of the first network that is."""

    def candidate(i: Array) -> Parameters:
        into, bias, out = jax.random.split(jax.random.fold_in(key, i), 3)
        hidden = GAIN / ORDER**0.5 * jax.random.normal(into, (UNITS, ORDER))
        return [
            (hidden, jax.random.normal(bias, (UNITS,))),
            (jax.random.normal(out, (1, UNITS)), jnp.zeros(1)),
        ]

    def tame(i: Array) -> Array:
        return lyapunov(candidate(i)) < LEAST

    return candidate(jax.lax.while_loop(tame, lambda i: i + 1, jnp.zeros((), int)))


def lyapunov(weights: Parameters, samples: int = 2000) -> Float[Array, ""]:
    """The largest exponent of a network without noise, per sample: how fast neighbours part."""
    f = Forward(weights)

    def step(carry: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], Array]:
        x, direction = carry
        x, moved = jax.jvp(lambda x: f(x, None), (x,), (direction,))
        length = jnp.linalg.norm(moved) + jnp.finfo(moved.dtype).tiny
        return (x, moved / length), jnp.log(length)

    start = (jnp.full(ORDER, 0.1), jnp.ones(ORDER) / ORDER**0.5)
    return jax.lax.scan(step, start, None, samples)[1][samples // 4 :].mean()
