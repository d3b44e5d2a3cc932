"""What a noise is as a density: draws of it, and the logarithm of its density.

Gaussian filters need the first two moments of a noise only, particle filters and `simulate` all of it.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Scalar

from sigmapoint.belief import Spread
from sigmapoint.compiled.native import LARGEST
from sigmapoint.linear_algebra.factors import cholesky, solve_lower

LOG_2PI = 1.8378770664093453
Standard = Callable[[Array, tuple[int, ...], Any], Array]


@runtime_checkable
class Density(Protocol):
    """A density of a vector of q elements; `standard` draws standard normal numbers where it is made of them."""

    def draws(self, key: Array, count: int, standard: Standard = jax.random.normal, /) -> Float[Array, "N q"]: ...

    def log_density(self, values: Float[Array, "N q"], active: Bool[Array, " q"], /) -> Float[Array, " N"]:
        """Of the elements that are active, the others left out of account."""
        ...


class Normal(NamedTuple):
    """A Gaussian density."""

    mean: Float[Array, " q"]
    spread: Spread
    whitening: Float[Array, "q q"]
    """inverse of the factor; as `whitening(cov)` gives it"""

    def draws(self, key: Array, count: int, standard: Standard = jax.random.normal) -> Float[Array, "N q"]:
        noise = standard(key, (count, self.mean.shape[0]), self.mean.dtype)
        return self.mean[None] + rows_times(self.spread.factor, noise)

    def log_density(self, values: Float[Array, "N q"], active: Bool[Array, " q"]) -> Float[Array, " N"]:
        q, dtype = self.mean.shape[0], values.dtype
        pairs = active[:, None] & active[None, :]
        W = jax.lax.cond(
            active.all(),
            lambda: self.whitening,
            lambda: whitening(jnp.where(pairs, self.spread.cov, jnp.eye(q, dtype=dtype))),
        )
        off = rows_times(W, jnp.where(active[None], values - self.mean[None], 0.0))
        constant = jnp.sum(jnp.log(jnp.diagonal(W))) - jnp.sum(active, dtype=dtype) * LOG_2PI / 2
        return constant - 0.5 * jnp.sum(off**2, axis=1)


def whitening(cov: Float[Array, "q q"]) -> Float[Array, "q q"]:
    """The inverse of its lower factor."""
    return solve_lower(cholesky(cov), jnp.eye(cov.shape[0], dtype=cov.dtype))


def rows_times(A: Float[Array, "q q"], rows: Float[Array, "N q"]) -> Float[Array, "N q"]:
    """Every row multiplied by a lower triangular matrix; a small one as sums, which vectorise over the rows."""
    q = rows.shape[1]
    if q > LARGEST // 2:
        return rows @ A.T
    columns = [sum(rows[:, j] * A[i, j] for j in range(i + 1)) for i in range(q)]
    return jnp.stack(columns, axis=1)


def finite_part(value: Scalar | Array, otherwise: float) -> Array:
    """`value` where it is finite."""
    return jnp.where(jnp.isfinite(value), value, otherwise)
