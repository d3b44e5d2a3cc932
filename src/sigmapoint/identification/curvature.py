"""What a Hessian says, and of which directions it says nothing.

A Hessian H of -log p is scaled to H = D C D with D² its diagonal; eigenvalues of C near zero (or below) belong to
directions that the measurements leave open. The rest has the covariance D⁻¹ V Λ⁻¹ Vᵀ D⁻¹; an element that takes part in
an open direction has none.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

WIDE = 1e3
"""Deviations of the prior, past which a curvature is none."""


class Curvature(NamedTuple):
    """A Hessian by its eigenvectors, after its diagonal has been scaled to one."""

    scale: Float[Array, " L"]
    values: Float[Array, " L"]
    vectors: Float[Array, "L L"]

    @classmethod
    def of(cls, hessian: Float[Array, "L L"]) -> "Curvature":
        """Of one in units of the prior deviations."""
        scale = jnp.sqrt(jnp.maximum(jnp.diagonal(hessian), WIDE**-2))
        scaled = hessian / (scale[:, None] * scale[None, :])
        values, vectors = jnp.linalg.eigh((scaled + scaled.T) / 2)
        return cls(scale, values, vectors)

    @property
    def least(self) -> float:
        """Of an eigenvalue that is more than round-off."""
        return float(jnp.finfo(self.values.dtype).eps) ** 0.5

    @property
    def clear(self) -> Bool[Array, " L"]:
        """Directions in which there is a curvature."""
        return self.values > self.least

    @property
    def open(self) -> Bool[Array, " L"]:
        """Elements that take part in a direction without a curvature, by more than what would not show."""
        part = jnp.where(self.clear[None, :], 0.0, jnp.abs(self.vectors)).max(axis=1)
        return ~(part < 0.1 * self.least**0.5)

    @property
    def cov(self) -> Float[Array, "L L"]:
        """The inverse of the Hessian, NaN in the rows and columns of open elements."""
        known = ~self.open
        inverse = (self.vectors * self._inverse[None, :]) @ self.vectors.T / (self.scale[:, None] * self.scale[None, :])
        return jnp.where(known[:, None] & known[None, :], inverse, jnp.nan)

    def solved(self, gradient: Float[Array, " L"]) -> Float[Array, " L"]:
        """H⁻¹ g, without the open directions."""
        return self.vectors @ (self._inverse * self._along(gradient)) / self.scale

    def distance(self, gradient: Float[Array, " L"]) -> Float[Array, ""]:
        """To the minimum, in standard deviations: √(gᵀ H⁻¹ g); along an open direction, the slope there."""
        along = self._along(gradient)
        return jnp.sqrt(jnp.sum(along**2 * jnp.where(self.clear, self._inverse, WIDE**-2)))

    @property
    def _inverse(self) -> Float[Array, " L"]:
        return jnp.where(self.clear, 1 / jnp.where(self.clear, self.values, 1.0), 0.0)

    def _along(self, gradient: Array) -> Array:
        return self.vectors.T @ (gradient / self.scale)
