"""A gamma-driven autoregression seen through two sensors in turn: the synthetic experiment of the particle filters.

    x[t+1] = 1 + sin(0.04 π t) + x[t] / 2 + w,  w ~ Γ(3, rate 2)        y[t] = x[t]² / 5 + v     for t ≤ 30
                                                                        y[t] = x[t] / 2 − 2 + v  for t > 30
    x[0] = 1                                                            v ~ N(0, 1e-5)

The noise has mean 3/2 and variance 3/4, a tail on one side and an end on the other: w > 0, so x > 0 at all times. And
the sensors are sharp: one measurement leaves a standard deviation of √1e-5 / |h'(x)|, 0.002 to 0.006 where x is usual,
of the 0.87 of the prediction. So `inverted`, the positive x at which the sensor would show y, is all but exact, and
whatever a filter is off beyond that is of its own making.

Source: Wan & van der Merwe, "The Unscented Kalman Filter" (2001), equations 7.120 and 7.121; the same in van der Merwe,
de Freitas, Doucet & Wan, "The Unscented Particle Filter", Advances in Neural Information Processing Systems 13 (2000).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.scipy.special import gammaln
from jaxtyping import Array, Bool, Float

from sigmapoint.model import StateSpaceModel
from sigmapoint.noise import Additive, Gaussian

STEPS = 60
"""that are measured, t = 1 … 60"""
SWITCH = 30
"""the last time of the first sensor"""
START, START_VARIANCE = 1.0, 0.75
"""what filters are told of x[0]; it is the mean"""
VARIANCE = 1e-5
"""of a measurement"""


class Gamma(eqx.Module):
    """The gamma distribution Γ(shape, rate) of one number, with the interface that noises are given in.

    Examples:
        >>> from sigmapoint.problems.gamma_autoregression import Gamma
        >>> noise = Gamma(shape=3.0, rate=2.0)
        >>> noise.mean, noise.variance
        (1.5, 0.75)
    """

    shape: float
    rate: float

    batch_shape = event_shape = ()

    @property
    def mean(self) -> float:
        return self.shape / self.rate

    @property
    def variance(self) -> float:
        return self.shape / self.rate**2

    def support(self, value: Float[Array, "*N"]) -> Bool[Array, "*N"]:
        """Whether a value is possible."""
        return value > 0

    def sample(self, key: Array, sample_shape: tuple[int, ...] = ()) -> Float[Array, "*N"]:
        """Draws."""
        return jax.random.gamma(key, self.shape, sample_shape) / self.rate

    def log_prob(self, value: Float[Array, "*N"]) -> Float[Array, "*N"]:
        """Logarithm of the density; of any number outside of the support."""
        inside = jnp.where(self.support(value), value, 1.0)
        constant = self.shape * jnp.log(self.rate) - gammaln(self.shape)
        return constant + (self.shape - 1) * jnp.log(inside) - self.rate * inside


NOISE = Gamma(shape=3.0, rate=2.0)


def model(noise_mean: float = NOISE.mean) -> StateSpaceModel:
    """The model, with the time t as input.

    Args:
        noise_mean: mean that Gaussian filters take the process noise to have; its variance they take as it is, and
            particle filters take the gamma distribution.

    Examples:
        >>> import jax, jax.numpy as jnp, sigmapoint as sp
        >>> from sigmapoint.problems import gamma_autoregression
        >>> x, y = gamma_autoregression.drawn(jax.random.key(0))
        >>> model, t = gamma_autoregression.model(), gamma_autoregression.times()
        >>> post = sp.filter(model, y, t, method=sp.bootstrap(200), key=1)
        >>> post.mean.shape
        (61, 1)
    """
    return StateSpaceModel(
        dynamics=_dynamics,
        observation=_observation,
        process_noise=Additive(jnp.full((1, 1), NOISE.variance), jnp.full(1, noise_mean), NOISE),
        observation_noise=VARIANCE * jnp.eye(1),
        initial=Gaussian(jnp.full(1, START), START_VARIANCE * jnp.eye(1)),
        state_names=("x",),
        observation_names=("y",),
    )


def times() -> Float[Array, " T"]:
    """0 to 60: the input of the model."""
    return jnp.arange(STEPS + 1.0)


def _dynamics(x: Float[Array, "1"], t: Float[Array, ""]) -> Float[Array, "1"]:
    return 1 + jnp.sin(0.04 * jnp.pi * t) + x / 2


def _observation(x: Float[Array, "1"], t: Float[Array, ""]) -> Float[Array, "1"]:
    return jnp.where(t <= SWITCH, x**2 / 5, x / 2 - 2)


def drawn(key: Array) -> tuple[Float[Array, "T 1"], Float[Array, "T 1"]]:
    """States, from x[0] = 1 on, and measurements, of which the first, at t = 0, is missing."""
    of_process, of_sensor = jax.random.split(key)
    t, w = times(), NOISE.sample(of_process, (STEPS, 1))

    def step(x: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
        after = _dynamics(x, row[0]) + row[1]
        return after, after

    start = jnp.full(1, START)
    x = jnp.concatenate([start[None], jax.lax.scan(step, start, (t[:-1], w))[1]])
    y = jax.vmap(_observation)(x, t) + VARIANCE**0.5 * jax.random.normal(of_sensor, x.shape)
    return x, y.at[0].set(jnp.nan)


def inverted(y: Float[Array, "*R T 1"]) -> Float[Array, "*R T 1"]:
    """The positive x at which the sensor would show y, at each time; at least zero."""
    root = jnp.sqrt(5 * jnp.maximum(y, 0.0))
    return jnp.where(times()[:, None] <= SWITCH, root, jnp.maximum(2 * (y + 2), 0.0))
