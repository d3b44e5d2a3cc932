"""Beliefs: a Gaussian as (mean, covariance) or as (mean, square root), and the one operation behind every filter step.

Two jointly Gaussian vectors, both written over the same standard normal variables (`Linearization`),

    y ≈ ȳ + Φ_y ξ + E_y ε + v,   x ≈ x̄ + Φ_x ξ + E_x ε,   v ~ N(0, R),

are split into y and the part of x that y does not determine: S Sᵀ = P_yy, W = P_xy S⁻ᵀ (so the gain is K = W S⁻¹) and
the remainder B of x given y. Conditioning on a measurement and reversing a transition (for smoothing) are both this.

* Dense: B = (Φ_x − K Φ_y)(·)ᵀ + (E_x − K E_y)(·)ᵀ + K R Kᵀ, Joseph's form: a sum of squares, never a difference.
* Square root: `tria [[Φ_y E_y S_R], [Φ_x E_x 0]] = [[S 0], [W B]]`, one Householder triangularisation, no downdate.

Rows of y that carry no information (not measured, without variance, or exact combinations of the rows before) have a
gain of exactly zero and a unit row in S, so that S stays regular.
"""

from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from sigmapoint.linalg import cholesky, norm_rows, safe_sqrt, solve_lower, solve_upper, tria
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


class Split(NamedTuple):
    """`y` and the rest of `x`: factor S of P_yy, root gain W (gain K = W S⁻¹), and spread B of x given y."""

    factor: Float[Array, "d d"]
    gain_root: Float[Array, "n d"]
    remainder: Float[Array, "n n"]
    informative: Bool[Array, " d"]
    """rows of y that say something: measured, with a variance, and not a combination of the rows before"""

    def gain(self, difference: Float[Array, "d *k"]) -> Float[Array, "n *k"]:
        """K times a difference in y."""
        return self.gain_root @ solve_lower(self.factor, difference)


class Dense(NamedTuple):
    """Mean and covariance. `mean` may be longer than the covariance (a point on a manifold)."""

    mean: Float[Array, " d"]
    cov: Float[Array, "n n"]

    @property
    def factor(self) -> Float[Array, "n n"]:
        return cholesky(self.cov)

    @property
    def std(self) -> Float[Array, " n"]:
        return safe_sqrt(jnp.diagonal(self.cov))

    @classmethod
    def of(cls, mean: Float[Array, " d"], cov: Float[Array, "n n"]) -> "Dense":
        """From a mean and a covariance."""
        return cls(mean, cov)

    @classmethod
    def assemble(cls, mean: Float[Array, " d"], spread: Float[Array, "n n"]) -> "Dense":
        """From a mean and what `split` gives as remainder: a covariance (dense) or a factor (square root)."""
        return cls(mean, spread)

    @classmethod
    def marginal(cls, x: Linearization, noise: Spread | None) -> "Dense":
        """The belief about `x`, with independent noise added."""
        return cls(x.mean, covariance(x, noise))

    @classmethod
    def split(cls, y: Linearization, x: Linearization, noise: Spread | None, active: Bool[Array, " d"]) -> Split:
        """Split the joint of `y` (plus noise) and `x`; see the module."""
        y, noise = _emptied(y, active), None if noise is None else noise.masked(active)
        P = covariance(y, noise)
        S = cholesky(P)
        noise_floor = 16 * jnp.finfo(P.dtype).eps * jnp.diagonal(P)
        informative = active & ~(jnp.diagonal(S) ** 2 <= noise_floor)
        y, noise = _emptied(y, informative), None if noise is None else noise.masked(informative)
        S = jnp.where(informative[:, None], S, jnp.eye(S.shape[0], dtype=S.dtype))
        W = solve_lower(S, y.slope @ x.slope.T + _product(y.residual, x.residual)).T
        K = solve_upper(S, W.T).T
        parts = [x.slope - K @ y.slope, _padded(x.residual, y.residual) - K @ y.residual]
        B = sum((p @ p.T for p in parts), start=jnp.zeros_like(x.slope @ x.slope.T))
        if noise is not None:
            B = B + K @ noise.cov @ K.T
        return Split(S, W, symmetric(B), informative)

    @classmethod
    def mix(cls, mean: Float[Array, " d"], root: Float[Array, "n k"], remainder: Float[Array, "n n"]) -> "Dense":
        """The belief with covariance `root rootᵀ` plus the remainder of a `split`."""
        return cls(mean, symmetric(root @ root.T + remainder))


class SquareRoot(NamedTuple):
    """Mean and lower factor of the covariance."""

    mean: Float[Array, " d"]
    factor: Float[Array, "n n"]

    @property
    def cov(self) -> Float[Array, "n n"]:
        return symmetric(self.factor @ self.factor.T)

    @property
    def std(self) -> Float[Array, " n"]:
        return norm_rows(self.factor)

    @classmethod
    def of(cls, mean: Float[Array, " d"], cov: Float[Array, "n n"]) -> "SquareRoot":
        return cls(mean, cholesky(cov))

    @classmethod
    def assemble(cls, mean: Float[Array, " d"], spread: Float[Array, "n n"]) -> "SquareRoot":
        return cls(mean, spread)

    @classmethod
    def marginal(cls, x: Linearization, noise: Spread | None) -> "SquareRoot":
        if noise is None:
            return cls(x.mean, tria(jnp.concatenate([x.slope, x.residual], axis=1)))
        columns = [x.slope, x.residual, jax.lax.stop_gradient(noise.factor)]
        return cls(x.mean, tria(jnp.concatenate(columns, axis=1), known=noise.cov))

    @classmethod
    def split(cls, y: Linearization, x: Linearization, noise: Spread | None, active: Bool[Array, " d"]) -> Split:
        d, n, dtype = y.slope.shape[0], x.slope.shape[0], y.slope.dtype
        if noise is None:
            noise = Spread(jnp.zeros((d, d), dtype), jnp.zeros((d, 0), dtype))
        y, noise = _emptied(y, active), noise.masked(active)
        top = jnp.concatenate([y.slope, y.residual, jax.lax.stop_gradient(noise.factor)], axis=1)
        bottom = jnp.concatenate([x.slope, _padded(x.residual, y.residual)], axis=1)
        bottom = jnp.pad(bottom, ((0, 0), (0, top.shape[1] - bottom.shape[1])))
        root = tria(jnp.concatenate([top, bottom]), known=jnp.pad(noise.cov, ((0, n), (0, n))), tested=d)
        informative = active & (jnp.diagonal(root)[:d] != 0)
        S = jnp.where(informative[:, None], root[:d, :d], jnp.eye(d, dtype=dtype))
        return Split(S, root[d:, :d], root[d:, d:], informative)

    @classmethod
    def mix(cls, mean: Float[Array, " d"], root: Float[Array, "n k"], remainder: Float[Array, "n n"]) -> "SquareRoot":
        return cls(mean, tria(jnp.concatenate([root, remainder], axis=1)))


Belief: TypeAlias = Dense | SquareRoot


def covariance(x: Linearization, noise: Spread | None) -> Float[Array, "d d"]:
    """Φ Φᵀ + E Eᵀ, plus that of the noise: exactly symmetric."""
    P = x.slope @ x.slope.T + x.residual @ x.residual.T
    return symmetric(P if noise is None else P + noise.cov)


def symmetric(P: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """The symmetric part of a matrix."""
    return (P + P.T) / 2


def _emptied(y: Linearization, keep: Bool[Array, " d"]) -> Linearization:
    """y without the rows that are not kept."""
    rows = keep[:, None]
    return Linearization(y.mean, jnp.where(rows, y.slope, 0.0), jnp.where(rows, y.residual, 0.0))


def _padded(residual: Array, like: Array) -> Array:
    """The residual of x over the ε of y: x that is exactly linear in ξ has no columns of its own."""
    return residual if residual.shape[1] else jnp.zeros((residual.shape[0], like.shape[1]), residual.dtype)


def _product(Ey: Array, Ex: Array) -> Array:
    return Ey @ Ex.T if Ex.shape[1] else jnp.zeros((Ey.shape[0], Ex.shape[0]), Ey.dtype)
