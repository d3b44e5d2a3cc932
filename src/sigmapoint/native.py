"""Small array programs in a form that XLA compiles into one native function.

On a CPU, XLA turns a loop over time into one function, without a dispatch for each operation, where its body has small
buffers only and calls no library (`runtime`). Then three things decide over its speed, and they are arranged here:

* A matrix product is a library call. `product` writes a small one as a sum of outer products, which vectorises;
  `folding` does the same inside a user's function.
* XLA computes anew what it fuses into several places: a chain of n steps can cost 2ⁿ. `materialized` keeps a value.
* Library factorisations are calls too; `linalg` has its own for small sizes.

Larger arrays are faster in the libraries, and so is everything where loops are not native.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend import core
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, Float

from sigmapoint.runtime import NATIVE

LARGEST = 24
"""The largest dimension of a small array."""


def small(n: int) -> bool:
    """Whether arrays of dimension `n` are handled here rather than in a library."""
    return NATIVE and n <= LARGEST


def product(A: Float[Array, "n k"], B: Float[Array, "k m"]) -> Float[Array, "n m"]:
    """`A @ B`."""
    n, k = A.shape
    if not small(max(n, B.shape[1])) or not 0 < k <= 4 * LARGEST:
        return A @ B
    A, B = materialized(A), materialized(B)
    total = A[:, :1] * B[:1]
    for i in range(1, k):
        total = total + A[:, i : i + 1] * B[i : i + 1]
    return total


def applied(A: Float[Array, "n k"], x: Float[Array, " k"]) -> Float[Array, " n"]:
    """`A @ x`."""
    return product(A, x[:, None])[:, 0]


def materialized(x: Array) -> Array:
    """`x`, computed once: it is not fused into what uses it."""
    return _materialized_p.bind(x) if NATIVE and not isinstance(x, np.ndarray) and x.size > 1 else x


def _kept(x: Array) -> Array:
    # A branch that no finite number takes; the compiler does not know that, and has to keep the value.
    never = jnp.ravel(x)[0] > jnp.inf
    return jax.lax.cond(never, lambda x: x + x, lambda x: x, x)


_materialized_p = core.Primitive("materialized")
_materialized_p.def_impl(lambda x: x)
_materialized_p.def_abstract_eval(lambda x: x)
ad.deflinear2(_materialized_p, lambda cotangent, _: [_materialized_p.bind(ad.instantiate_zeros(cotangent))])
batching.defvectorized(_materialized_p)
mlir.register_lowering(_materialized_p, lambda ctx, x: [x])
mlir.register_lowering(_materialized_p, mlir.lower_fun(_kept, multiple_results=False), platform="cpu")
