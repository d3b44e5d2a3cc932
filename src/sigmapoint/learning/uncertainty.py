"""What is known about parameters beside their mean: a factor of the covariance, or the covariance.

Both view a function, take in a measurement of it, and grow between measurements: a factor in O(M L²), a covariance in
O(L³), for its points need a Cholesky factor (the plain unscented filter).
"""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint.learning.triangular import conditioned
from sigmapoint.linalg import cholesky, one_where_zero
from sigmapoint.rules.linearization import Rule
from sigmapoint.spaces import Euclidean

Step = Callable[[Float[Array, " L"]], Float[Array, " M"]]
"""A function of a displacement of the parameters."""


class View(NamedTuple):
    """What a function says about parameters, and they about it."""

    mean: Float[Array, " M"]
    bend: Float[Array, "M k"]
    """columns of what its linearisation leaves out"""
    slope: Float[Array, "M L"]
    """over the columns of the factor"""
    explained: Float[Array, "M M"]
    """covariance of the value by that of the parameters"""


class Updated(NamedTuple):
    """What a measurement has changed."""

    uncertainty: "Uncertainty"
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

    def view(self, rule: Rule, g: Step) -> View:
        """Of `g`, linearised about the mean."""
        lin = rule(g, self.factor, Euclidean())
        return View(lin.mean, lin.bend, lin.slope, lin.slope @ lin.slope.T)

    def updated(self, view: View, noise: Float[Array, "M M"]) -> Updated:
        """After a measurement of what was viewed; `noise` is all of its covariance that is not explained."""
        seen = conditioned(self.columns, view.slope, cholesky(noise))
        return Updated(Factor(seen.columns, seen.variance), seen.gain, seen.factor)


class Covariance(NamedTuple):
    """The covariance; its factor is found anew for every update."""

    cov: Float[Array, "L L"]

    @classmethod
    def of(cls, std: Float[Array, " L"]) -> "Covariance":
        return cls(jnp.diag(std**2))

    @property
    def factor(self) -> Float[Array, "*many L L"]:
        return cholesky(self.cov)

    @property
    def variance(self) -> Float[Array, " L"]:
        return jnp.diagonal(self.cov)

    def inflated(self, added: Float[Array, " L"]) -> "Covariance":
        scale, alone = _growth(self.variance, added)
        return Covariance(self.cov * (scale[None, :] * scale[:, None]) + jnp.diag(alone))

    def on_diagonal(self, added: Float[Array, " L"]) -> "Covariance":
        """P + diag(added)."""
        return Covariance(self.cov + jnp.diag(added))

    def view(self, rule: Rule, g: Step) -> View:
        return self._factored().view(rule, g)

    def updated(self, view: View, noise: Float[Array, "M M"]) -> Updated:
        # By way of the factor, whose square cannot have a negative variance.
        after = self._factored().updated(view, noise)
        return after._replace(uncertainty=Covariance(after.uncertainty.cov))

    def _factored(self) -> Factor:
        return Factor(self.factor.T, self.variance)


Uncertainty: TypeAlias = Factor | Covariance


def _growth(variance: Array, added: Array) -> tuple[Array, Array]:
    """What to multiply standard deviations by, and the variance of those that have none."""
    none = variance <= 0
    scale = jnp.sqrt(1 + jnp.where(none, 0.0, added) / one_where_zero(jnp.where(none, 0.0, variance)))
    return scale, jnp.where(none, added, 0.0)
