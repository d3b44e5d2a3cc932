"""A double inverted pendulum on a cart: two uniform rods, one on the other, on a cart that a force pushes.

With q = (x, θ₁, θ₂), angles from the upright, the centres of the rods are at

    (x − l₁ sin θ₁, l₁ cos θ₁)    and    (x − 2 l₁ sin θ₁ − l₂ sin θ₂, 2 l₁ cos θ₁ + l₂ cos θ₂),

l being half the length of a rod, m l²/3 its moment of inertia. Lagrange's equations are M(q) q̈ = r(q, q̇, u):

    (M + m₁ + m₂) ẍ − a cos θ₁ θ̈₁ − b cos θ₂ θ̈₂            = u − a sin θ₁ θ̇₁² − b sin θ₂ θ̇₂²
    −a cos θ₁ ẍ + 4 (m₁/3 + m₂) l₁² θ̈₁ + c cos(θ₂ − θ₁) θ̈₂ = a g sin θ₁ + c sin(θ₂ − θ₁) θ̇₂²
    −b cos θ₂ ẍ + c cos(θ₂ − θ₁) θ̈₁ + 4/3 m₂ l₂² θ̈₂        = b g sin θ₂ − c sin(θ₂ − θ₁) θ̇₁²

with a = (m₁ + 2 m₂) l₁, b = m₂ l₂, c = 2 m₂ l₁ l₂. Without a force all terms are proportional to the masses: the motion
depends on their ratios only.

Source: Wan & van der Merwe, "The Unscented Kalman Filter" (2001), eqs 7.64-7.69. As printed, both centrifugal terms of
the first equation (7.65) have the other sign, which does not conserve energy; the rest agrees with the derivation.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

GRAVITY = 9.81
"""[m/s²]"""
STEP = 0.02
"""[s]"""


class Parameters(NamedTuple):
    """What there is of it."""

    l1: Any
    """[m] half the length of the lower rod"""
    l2: Any
    """[m] half the length of the upper rod"""
    m1: Any
    """[kg] mass of the lower rod"""
    m2: Any
    """[kg] mass of the upper rod"""
    M: Any
    """[kg] mass of the cart"""


TRUTH = Parameters(0.5, 0.75, 0.75, 0.5, 1.5)


def accelerations(
    p: Parameters, q: Float[Array, " 3"], v: Float[Array, " 3"], force: Float[Array, ""]
) -> Float[Array, " 3"]:
    """Those of place and angles [m/s², rad/s²].

    Args:
        p: the parameters.
        q: place of the cart [m] and angles of the lower and the upper rod from the upright [rad].
        v: their rates [m/s, rad/s].
        force: on the cart [N].
    """
    _, one, two = q
    _, rate1, rate2 = v
    a, b, c = (p.m1 + 2 * p.m2) * p.l1, p.m2 * p.l2, 2 * p.m2 * p.l1 * p.l2
    centrifugal = c * jnp.sin(two - one)
    r1 = force - a * jnp.sin(one) * rate1**2 - b * jnp.sin(two) * rate2**2
    r2 = a * GRAVITY * jnp.sin(one) + centrifugal * rate2**2
    r3 = b * GRAVITY * jnp.sin(two) - centrifugal * rate1**2
    m11, m22, m33 = p.M + p.m1 + p.m2, 4 * (p.m1 / 3 + p.m2) * p.l1**2, 4 / 3 * p.m2 * p.l2**2
    m12, m13, m23 = -a * jnp.cos(one), -b * jnp.cos(two), c * jnp.cos(two - one)
    # Cramer's rule in scalars: no call of LAPACK within a loop.
    c11, c12, c13 = m22 * m33 - m23**2, m13 * m23 - m12 * m33, m12 * m23 - m13 * m22
    c22, c23, c33 = m11 * m33 - m13**2, m12 * m13 - m11 * m23, m11 * m22 - m12**2
    adjugate = (c11 * r1 + c12 * r2 + c13 * r3, c12 * r1 + c22 * r2 + c23 * r3, c13 * r1 + c23 * r2 + c33 * r3)
    return jnp.stack(adjugate) / (m11 * c11 + m12 * c12 + m13 * c13)


def derivative(p: Parameters, state: Float[Array, " 6"], force: Float[Array, ""]) -> Float[Array, " 6"]:
    """Of the state (x, ẋ, θ₁, θ̇₁, θ₂, θ̇₂) [m, m/s, rad, rad/s, rad, rad/s] by time [s], under a force [N]."""
    rates = state[1::2]
    return jnp.stack([rates, accelerations(p, state[::2], rates, force)], axis=1).reshape(6)


def moved(p: Parameters, state: Float[Array, " 6"], force: Float[Array, ""], step: float = STEP) -> Float[Array, " 6"]:
    """The state after a `step` [s] under a constant force [N]: Runge-Kutta, fourth order.

    Examples:
        >>> import jax.numpy as jnp
        >>> from sigmapoint.problems import pendulum
        >>> pendulum.moved(pendulum.TRUTH, jnp.zeros(6), jnp.array(0.0)).tolist()  # upright, and stays so
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    """
    k1 = derivative(p, state, force)
    k2 = derivative(p, state + step / 2 * k1, force)
    k3 = derivative(p, state + step / 2 * k2, force)
    k4 = derivative(p, state + step * k3, force)
    return state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def fallen(state: Float[Array, "*many 6"]) -> Bool[Array, "*many"]:
    """Whether a rod has passed the horizontal."""
    return (jnp.abs(state[..., 2]) > jnp.pi / 2) | (jnp.abs(state[..., 4]) > jnp.pi / 2)


def fall(
    p: Parameters, start: Float[Array, " 6"], forces: Float[Array, " T"], noise: Float[Array, "T 6"]
) -> Float[Array, "T+1 6"]:
    """The states from `start` on, a force [N] and a disturbance [units of the state] at each step."""

    def step(state: Array, given: tuple[Array, Array]) -> tuple[Array, Array]:
        force, disturbance = given
        state = moved(p, state, force) + disturbance
        return state, state

    return jnp.concatenate([start[None], jax.lax.scan(step, start, (forces, noise))[1]])
