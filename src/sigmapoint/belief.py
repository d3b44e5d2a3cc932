"""Beliefs: a Gaussian as (mean, covariance) or as (mean, square root).

Both give a factor to draw points with and take a factor back. They differ in what they keep between, and in how they
add up what a function's value is made of, Φ ξ + E ε + noise:

* Dense: P = Φ Φᵀ + E Eᵀ + Q, one Cholesky factorisation.
* Square root: L = tria [Φ E S_Q], one orthogonal triangularisation.
"""

from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from sigmapoint.compiled.native import gram, materialized
from sigmapoint.linear_algebra.factors import cholesky, norm_rows
from sigmapoint.linear_algebra.triangularization import tria
from sigmapoint.rules.linearization import Linearization


class Spread(NamedTuple):
    """A noise covariance together with a lower factor of it, made once and used by either belief."""

    cov: Float[Array, "q q"]
    factor: Float[Array, "q q"]

    @classmethod
    def of(cls, cov: Float[Array, "q q"]) -> "Spread":
        return cls(cov, cholesky(cov))

    def masked(self, active: Bool[Array, " q"]) -> "Spread":
        """The same noise without the rows that are not active."""
        rows = active.astype(self.cov.dtype)
        return Spread(self.cov * jnp.outer(rows, rows), self.factor * rows[:, None])


class Dense(NamedTuple):
    """Mean and covariance, and a lower factor of it. `mean` may be longer than they are (a point on a manifold)."""

    mean: Float[Array, " d"]
    cov: Float[Array, "n n"]
    factor: Float[Array, "n n"]

    @property
    def std(self) -> Float[Array, " n"]:
        return norm_rows(self.factor)

    @classmethod
    def of(cls, mean: Float[Array, " d"], cov: Float[Array, "n n"]) -> "Dense":
        """From a mean and a covariance."""
        return cls(mean, symmetric(cov), cholesky(cov))

    @classmethod
    def from_root(cls, mean: Float[Array, " d"], root: Float[Array, "n k"]) -> "Dense":
        """With covariance `root rootᵀ`; a square root is lower triangular."""
        cov = gram(root.T)
        return cls(mean, symmetric(cov), root) if root.shape[0] == root.shape[1] else cls.of(mean, cov)

    @classmethod
    def marginal(cls, x: Linearization, noise: Spread | None) -> "Dense":
        """The belief about `x`, with independent noise added."""
        return cls.of(x.mean, _sum(jnp.concatenate([x.slope, x.residual], axis=1), noise))

    @staticmethod
    def root(columns: Float[Array, "c k"], noise: Spread | None) -> Float[Array, "c c"]:
        """A lower factor of `columns columnsᵀ`, with independent noise added."""
        L = cholesky(_sum(columns, noise))
        if noise is None:
            return L
        # Pivots grow by what is added, so they are at least those of the noise: also where round-off has taken them.
        return jnp.where(np.eye(L.shape[0], dtype=bool), jnp.maximum(L, noise.factor), L)


class SquareRoot(NamedTuple):
    """Mean and lower factor of the covariance."""

    mean: Float[Array, " d"]
    factor: Float[Array, "n n"]

    @property
    def cov(self) -> Float[Array, "n n"]:
        return symmetric(gram(self.factor.T))

    @property
    def std(self) -> Float[Array, " n"]:
        return norm_rows(self.factor)

    @classmethod
    def of(cls, mean: Float[Array, " d"], cov: Float[Array, "n n"]) -> "SquareRoot":
        return cls(mean, cholesky(cov))

    @classmethod
    def from_root(cls, mean: Float[Array, " d"], root: Float[Array, "n k"]) -> "SquareRoot":
        return cls(mean, root if root.shape[0] == root.shape[1] else tria(root))

    @classmethod
    def marginal(cls, x: Linearization, noise: Spread | None) -> "SquareRoot":
        return cls(x.mean, cls.root(jnp.concatenate([x.slope, x.bend], axis=1), noise))

    @staticmethod
    def root(columns: Float[Array, "c k"], noise: Spread | None) -> Float[Array, "c c"]:
        if noise is None:
            return tria(columns)
        return tria(jnp.concatenate([columns, jax.lax.stop_gradient(noise.factor)], axis=1), known=noise.cov)


Belief: TypeAlias = Dense | SquareRoot


def covariance(x: Linearization, noise: Spread | None) -> Float[Array, "d d"]:
    """Φ Φᵀ + E Eᵀ, plus that of the noise: exactly symmetric."""
    return symmetric(_sum(jnp.concatenate([x.slope, x.residual], axis=1), noise))


def _sum(columns: Float[Array, "c k"], noise: Spread | None) -> Float[Array, "c c"]:
    P = gram(columns.T)
    return P if noise is None else P + noise.cov


def symmetric(P: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """The symmetric part of a matrix."""
    return materialized((P + P.T) / 2)
