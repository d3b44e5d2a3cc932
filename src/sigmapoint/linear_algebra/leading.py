"""An identity that has the axis of `jax.vmap` in front.

Under `jax.jit`, JAX takes the mapped axis of what a `jax.custom_jvp` function gives for that of its derivative. Where
the two lie differently, or one of them is not mapped, a derivative of the mapped function fails: so both end here.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jax.extend import core
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array


def leading(value: Any, *arguments: Any) -> Any:
    """`value`, arrays that are mapped where one of the `arguments` is."""
    given = [a for a in jax.tree.leaves(arguments) if isinstance(a, jax.Array)]
    return jax.tree.map(lambda x: _leading_p.bind(x, *given), value)


def _batched(arrays: Any, axes: Any) -> tuple[Array, int]:
    size = next(a.shape[axis] for a, axis in zip(arrays, axes) if axis is not None)
    first = [a if axis is None else jnp.moveaxis(a, axis, 0) for a, axis in zip(arrays, axes)]
    if axes[0] is None:
        first[0] = jnp.broadcast_to(first[0], (size, *first[0].shape))
    return _leading_p.bind(*first), 0


def _jvp(primals: Any, tangents: Any) -> tuple[Array, Array]:
    return _leading_p.bind(*primals), _leading_p.bind(ad.instantiate_zeros(tangents[0]), *primals[1:])


def _transposed(cotangent: Any, x: Any, *given: Any) -> list[Any]:
    return [_leading_p.bind(ad.instantiate_zeros(cotangent), *given), *(None,) * len(given)]


_leading_p = core.Primitive("leading")
_leading_p.def_impl(lambda x, *given: x)
_leading_p.def_abstract_eval(lambda x, *given: x)
ad.primitive_jvps[_leading_p] = _jvp
ad.primitive_transposes[_leading_p] = _transposed
batching.primitive_batchers[_leading_p] = _batched
mlir.register_lowering(_leading_p, lambda ctx, x, *given: [x])
