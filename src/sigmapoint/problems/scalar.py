"""A scalar model whose sensor is a cubic: the example of Plett's lecture notes on nonlinear Kalman filters.

    x⁺ = √(5 + x) + w,  w ~ N(0, 1)        z = x³ + v,  v ~ N(0, 2)        x[0] ~ N(2, 1)

About its usual place, x ≈ 2.8, the sensor is worth a standard deviation of 0.06 in x where the prediction is worth 1.
So one measurement says nearly all, but only to a filter that knows how far the cubic bends over the prior: a tangent
at the prediction claims the full 0.06 and misses by several times that.

Source: G. L. Plett, *ECE5550: Applied Kalman Filtering*, chapter 6, sections 6.2 (EKF) and 6.6 (SPKF).

The guard of the square root. The notes clamp the extended filter's estimate, x̂ ← max(−5, x̂), "don't get square root of
negative xhat"; at x̂ = −5 their derivative 1/(2√(5 + x̂)) is infinite. Here states live on the half-line x ≥ −5 (truth,
estimates and sigma points alike, by the model's space), and the root's argument has a floor that keeps its derivative
finite. True states come near −5 with a probability of about 1e-13 a step, so the truth is that of the notes.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

import sigmapoint as sp

STEPS = 40
"""Length of a series in the notes."""
LOWEST = -5.0
"""[1] where the square root ends: the notes' clamp."""
FLOOR = 1e-12
"""[1] least argument of the square root, for a finite derivative."""


GRID = (-4.5, 9.5, 1401)
"""[1] grid of the exact posterior, a hundredth apart: its deviations are seldom below 0.02."""


@dataclass(frozen=True)
class HalfLine:
    """The space x ≥ −5: a step beyond the end stops there."""

    def residual(self, a: Float[Array, " d"], b: Float[Array, " d"]) -> Float[Array, " d"]:
        return a - b

    def retract(self, point: Float[Array, " d"], step: Float[Array, " d"]) -> Float[Array, " d"]:
        return jnp.maximum(point + step, LOWEST)


def model() -> sp.StateSpaceModel:
    """The model of the notes; every quantity is without unit.

    Returns:
        A model with one state and one measurement.

    Examples:
        >>> import jax, sigmapoint as sp
        >>> from sigmapoint.problems import scalar
        >>> x, z = sp.simulate(scalar.model(), scalar.STEPS, key=jax.random.key(0))
        >>> x.shape, z.shape
        ((40, 1), (40, 1))
    """
    return sp.StateSpaceModel(
        dynamics=_dynamics,
        observation=_observation,
        process_noise=jnp.eye(1),
        observation_noise=2 * jnp.eye(1),
        initial=sp.Gaussian(jnp.array([2.0]), jnp.eye(1)),
        state_space=HalfLine(),
        state_names=("x",),
        observation_names=("z",),
    )


def _dynamics(x: Float[Array, " d"], u: None) -> Float[Array, " d"]:
    return jnp.sqrt(jnp.maximum(x - LOWEST, FLOOR))


def _observation(x: Float[Array, " d"], u: None) -> Float[Array, " d"]:
    return x**3


@jax.jit
def exact_posterior(z: Float[Array, "R T"]) -> tuple[Float[Array, "R T"], Float[Array, "R T"]]:
    """Mean and standard deviation of x[k] given z[0] … z[k] by Bayes' rule on a grid, for R series at once.

    Args:
        z: measurements, without gaps.
    """
    x = jnp.linspace(*GRID)
    moved = jnp.exp(-0.5 * (x[None, :] - jnp.sqrt(x - LOWEST)[:, None]) ** 2)
    moved = moved / moved.sum(1, keepdims=True)

    def step(prior: Array, z_k: Array) -> tuple[Array, tuple[Array, Array]]:
        fit = -0.25 * (z_k[:, None] - x[None, :] ** 3) ** 2
        p = prior * jnp.exp(fit - fit.max(1, keepdims=True))
        p = p / p.sum(1, keepdims=True)
        mean = p @ x
        return p @ moved, (mean, jnp.sqrt(jnp.sum(p * (x[None, :] - mean[:, None]) ** 2, 1)))

    prior = jnp.broadcast_to(jnp.exp(-0.5 * (x - 2) ** 2), (z.shape[0], x.shape[0]))
    _, (mean, std) = jax.lax.scan(step, prior, z.T)
    return mean.T, std.T
