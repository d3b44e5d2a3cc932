"""What is known about parameters beside their mean: a factor of the covariance, or the covariance.

Both grow between measurements. Points are drawn from a factor, and a measurement is taken in by one, in O(M L²): so a
covariance cannot get a negative variance, but costs a Cholesky factor each time, O(L³) (the plain unscented filter).
"""

from typing import NamedTuple, TypeAlias

import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint.learning.triangular import conditioned
from sigmapoint.linear_algebra.factors import cholesky, one_where_zero


class Updated(NamedTuple):
    """What a measurement has changed."""

    uncertainty: "Factor"
    gain: Float[Array, "M L"]
    """the gain times the factor of the innovation, transposed"""
    factor: Float[Array, "M M"]
    """lower factor of the covariance of the innovation"""


class Factor(NamedTuple):
    """Rows of `columns` are the columns of a lower factor S, P = S Sᵀ."""

    columns: Float[Array, "*many L L"]
    variance: Float[Array, "*many L"]

    @classmethod
    def of(cls, std: Float[Array, " L"]) -> "Factor":
        """Independent parameters with these standard deviations."""
        return cls(jnp.diag(std), std**2)

    @property
    def factor(self) -> Float[Array, "*many L L"]:
        return self.columns.mT

    @property
    def cov(self) -> Float[Array, "*many L L"]:
        P = self.columns.mT @ self.columns
        return (P + P.mT) / 2

    def inflated(self, added: Float[Array, " L"]) -> "Factor":
        """With more variance in each parameter, correlations kept."""
        scale, alone = _growth(self.variance, added)
        return Factor(self.columns * scale[None, :] + jnp.diag(jnp.sqrt(alone)), self.variance + added)

    def on_diagonal(self, added: Float[Array, " L"]) -> "Factor":
        """S + D with D = √(diag(S)² + added) − diag(S)."""
        own = jnp.diagonal(self.columns)
        more = jnp.sqrt(own**2 + added) - own
        return Factor(self.columns + jnp.diag(more), self.variance + more * (2 * own + more))

    def updated(self, slope: Float[Array, "M L"], noise: Float[Array, "M M"], groups: int) -> Updated:
        """After a measurement with this slope over the columns; `noise` is the rest of its covariance.

        `groups`: as in `triangular.conditioned`.
        """
        after = conditioned(self.columns, slope, cholesky(noise), groups)
        return Updated(Factor(after.columns, after.variance), after.gain, after.factor)

    @property
    def factored(self) -> "Factor":
        """As a factor."""
        return self

    @classmethod
    def carried(cls, factor: "Factor") -> "Factor":
        """From a factor, as it is carried to the next update."""
        return factor


class Covariance(NamedTuple):
    """The covariance; its factor is found anew for every update."""

    cov: Float[Array, "*many L L"]

    @classmethod
    def of(cls, std: Float[Array, " L"]) -> "Covariance":
        return cls(jnp.diag(std**2))

    @property
    def factor(self) -> Float[Array, "*many L L"]:
        return jnp.vectorize(cholesky, signature="(n,n)->(n,n)")(self.cov)

    @property
    def variance(self) -> Float[Array, "*many L"]:
        return jnp.diagonal(self.cov, axis1=-2, axis2=-1)

    def inflated(self, added: Float[Array, " L"]) -> "Covariance":
        scale, alone = _growth(self.variance, added)
        return Covariance(self.cov * (scale[None, :] * scale[:, None]) + jnp.diag(alone))

    def on_diagonal(self, added: Float[Array, " L"]) -> "Covariance":
        """P + diag(added)."""
        return Covariance(self.cov + jnp.diag(added))

    @property
    def factored(self) -> Factor:
        return Factor(self.factor.T, self.variance)

    @classmethod
    def carried(cls, factor: Factor) -> "Covariance":
        return cls(factor.cov)


Uncertainty: TypeAlias = Factor | Covariance


def _growth(variance: Array, added: Array) -> tuple[Array, Array]:
    """What to multiply standard deviations by, and the variance of those that have none."""
    none = variance <= 0
    scale = jnp.sqrt(1 + jnp.where(none, 0.0, added) / one_where_zero(jnp.where(none, 0.0, variance)))
    return scale, jnp.where(none, added, 0.0)
