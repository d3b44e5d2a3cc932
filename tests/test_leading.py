"""Derivatives of a mapped `jax.custom_jvp` function whose value and derivative lie differently, or are not mapped."""

import jax
import jax.numpy as jnp
import numpy as np

from sigmapoint.leading import leading


@jax.custom_jvp
def _turned(x, besides):
    return leading(jnp.stack([x, x], axis=1).T, x, besides)


@_turned.defjvp
def _turned_jvp(primals, tangents):
    (x, besides), (dx, dbesides) = primals, tangents
    value = _turned(x, besides)
    return value, leading(jnp.stack([dx + dbesides, dx]), x, besides)


def test_value_and_derivative_lie_alike():
    def total(a, xs, at):
        mapped = jax.jit(
            jax.vmap(lambda x: _turned(x, a * xs[0]) if at is None else _turned(a * x, x), in_axes=at or 0)
        )
        return (jnp.concatenate([jnp.zeros((1, 2, 3)), mapped(xs)]) * jnp.arange(6.0).reshape(2, 3)).sum()

    xs = jnp.arange(12.0).reshape(4, 3)
    np.testing.assert_allclose(jax.grad(total)(2.0, xs, 0), (xs * (jnp.arange(3.0) + jnp.arange(3.0, 6.0))).sum())
    np.testing.assert_allclose(jax.grad(total)(2.0, xs.T, 1), (xs * (jnp.arange(3.0) + jnp.arange(3.0, 6.0))).sum())
    np.testing.assert_allclose(jax.grad(total)(2.0, xs, None), 4 * (xs[0] * jnp.arange(3.0)).sum())
    again = jax.vmap(jax.vmap(jax.grad(lambda x, b: _turned(x, b)[0].sum()), (0, None)), (None, 0))
    np.testing.assert_allclose(again(xs, xs), jnp.ones((4, 4, 3)))
