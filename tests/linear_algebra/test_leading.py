"""Derivatives of a mapped `jax.custom_jvp` function whose value and derivative lie differently, or are not mapped."""

import jax
import jax.numpy as jnp
import numpy as np

from sigmapoint.linear_algebra.leading import leading


@jax.custom_jvp
def _turned(x, besides):
    return leading(jnp.stack([x, x], axis=1).T, x, besides)


@_turned.defjvp
def _turned_jvp(primals, tangents):
    (x, besides), (dx, dbesides) = primals, tangents
    value = _turned(x, besides)
    return value, leading(jnp.stack([dx + dbesides, dx]), x, besides)


def _derivative(mapped, xs):
    return jax.jit(jax.grad(lambda a: (jnp.concatenate([jnp.zeros((1, 2, 3)), mapped(a)(xs)]) ** 2).sum()))(2.0)


def test_value_and_derivative_lie_alike():
    xs = jnp.arange(12.0).reshape(4, 3)
    # Both rows are 2 x; the derivative of the first is made to be 2 x, of the second x.
    front = _derivative(lambda a: jax.vmap(jax.jit(lambda x: _turned(a * x, a * x))), xs)
    behind = _derivative(lambda a: jax.vmap(jax.jit(lambda x: _turned(a * x, a * x)), in_axes=1), xs.T)
    np.testing.assert_allclose([front, behind], 2 * (2 * xs * (2 * xs + xs)).sum())


def test_what_is_not_mapped_has_a_mapped_derivative():
    xs, fixed = jnp.arange(12.0).reshape(4, 3), jnp.ones(3)
    found = _derivative(lambda a: jax.vmap(jax.jit(lambda x: _turned(fixed, a * x))), xs)
    np.testing.assert_allclose(found, 2 * xs.sum())
