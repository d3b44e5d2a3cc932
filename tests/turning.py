"""A turning body written twice: its heading as a unit vector (two numbers, one degree of freedom), or as an angle."""

import jax
import jax.numpy as jnp

import sigmapoint as sp

CIRCLE = sp.Manifold(
    lambda a, b: jnp.arctan2(b[0] * a[1] - b[1] * a[0], a[0] * b[0] + a[1] * b[1])[None],
    lambda m, d: jnp.stack([m[0] * jnp.cos(d[0]) - m[1] * jnp.sin(d[0]), m[0] * jnp.sin(d[0]) + m[1] * jnp.cos(d[0])]),
)
Q, R, P0 = 1e-3 * jnp.eye(1), 1e-2 * jnp.eye(1), 0.04 * jnp.eye(1)


def vector(angle: jax.Array) -> jax.Array:
    """(cos, sin) of angles (..., 1)."""
    return jnp.concatenate([jnp.cos(angle), jnp.sin(angle)], axis=-1)


def on_circle(rate) -> sp.StateSpaceModel:
    return sp.StateSpaceModel(
        lambda x, u: CIRCLE.retract(x, jnp.reshape(rate, 1)), lambda x, u: x, Q, R,
        sp.Gaussian(jnp.array([1.0, 0.0]), P0), state_space=CIRCLE, observation_space=CIRCLE,
    )  # fmt: skip


def as_angle(rate) -> sp.StateSpaceModel:
    return sp.StateSpaceModel(
        lambda x, u: x + rate, lambda x, u: x, Q, R, sp.Gaussian(jnp.zeros(1), P0),
        state_space=sp.angles(0), observation_space=sp.angles(0),
    )  # fmt: skip


def measured(T: int) -> jax.Array:
    """Angles (T, 1); one of them is missing."""
    y = sp.simulate(as_angle(0.3), T, key=7)[1]
    return y.at[T // 2].set(jnp.nan)
