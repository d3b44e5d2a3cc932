"""Two equal masses between two walls, on three springs: their places seen, their natural frequencies wanted.

    m ÿ₁ = −k y₁ + c (y₂ − y₁)        m ÿ₂ = −k y₂ + c (y₁ − y₂)

The masses move together (q₁) or against each other (q₂), whatever the springs are:

    q₁ = (y₁ + y₂)/√2    ω₁² = k/m            q₂ = (y₁ − y₂)/√2    ω₂² = (k + 2c)/m

so that two frequencies ω₁ < ω₂ are as good as two springs, and a step of any length is exact, two rotations:

    q⁺ = q cos ω dt + v sin(ω dt)/ω        v⁺ = v cos ω dt − q ω sin ω dt

With dt = π/ω₂, at Nyquist, the second mode changes its sign at every step: of a motion that passes its middle at a
sample nothing is ever seen, of any other one the sign and the size, but not the phase. What lies at ω₂ + ε then looks,
with the phase reversed, like ω₂ − ε; and at 1/r of that step, like (2r − 1) ω₂ (which is outside the starts for r ≥ 2).

Source: Wan & van der Merwe, "The Unscented Kalman Filter" (2001), section 7.5.1, Figure 7.14 (which shows two masses
and no numbers).
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint.model import StateSpaceModel
from sigmapoint.noise import Gaussian

TRUTH = np.array([1.0, 3.0])
"""[rad/s] for m = 1 kg: k = 1 N/m, c = 4 N/m"""
SHAPES = np.array([[1.0, 1.0], [1.0, -1.0]]) / np.sqrt(2)
"""places of both masses, for a unit of either mode"""
SCALE = np.concatenate([np.ones(2), TRUTH])
"""[m, m/s] rms of (q₁, q₂, v₁, v₂) and, of the first two, of the places"""
PROCESS, MEASUREMENT = 1e-5, 1e-3
"""noise over signal, rms: −100 dB and −60 dB"""
STATES = ("together", "against", "rate_together", "rate_against")


class Start(NamedTuple):
    """What is known of the motion at first."""

    mean: Float[Array, "4"]
    std: Float[Array, "4"]


def moved(omega: Float[Array, "2"], x: Float[Array, "4"], dt: Float[Array, ""]) -> Float[Array, "4"]:
    """The state (q₁, q₂, v₁, v₂) [m, m/s] after a time `dt` [s], at the frequencies `omega` [rad/s]."""
    q, v = x[:2], x[2:]
    c, s = jnp.cos(omega * dt), jnp.sin(omega * dt)
    return jnp.concatenate([c * q + s / omega * v, c * v - s * omega * q])


def places(x: Float[Array, "4"]) -> Float[Array, "2"]:
    """Of the masses [m], from where they rest."""
    return jnp.asarray(SHAPES, x.dtype) @ x[:2]


def model(omega: Float[Array, "2"], dt: Float[Array, ""], start: Start) -> StateSpaceModel:
    """The masses, seen every `dt` [s]; states in modes, places as measurements.

    Examples:
        >>> import jax.numpy as jnp
        >>> from sigmapoint.problems import masses
        >>> rest = masses.Start(jnp.zeros(4), jnp.ones(4))
        >>> masses.model(jnp.asarray(masses.TRUTH), jnp.array(0.1), rest).state_names[1]
        'against'
    """
    return StateSpaceModel(
        dynamics=lambda x, u: moved(omega, x, dt),
        observation=lambda x, u: places(x),
        process_noise=jnp.diag(jnp.asarray((PROCESS * SCALE) ** 2)),
        observation_noise=MEASUREMENT**2 * jnp.eye(2),
        initial=Gaussian(start.mean, jnp.diag(start.std**2)),
        state_names=STATES,
        state_units=("m", "m", "m/s", "m/s"),
        observation_names=("y1", "y2"),
        observation_units=("m", "m"),
    )
