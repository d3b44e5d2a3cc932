"""Sets of sigma points, and what makes a linearisation of the function values at them.

A set is four constant arrays that depend on the dimension alone: a new rule is a function that fills them in. With
non-negative weights `w`, `√w` and the rows `√w ξ_j` are orthonormal for every set that is exact to second degree; the
mean and Φ are the projections on them, and E is what is left, in any orthonormal basis.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint.compiled.native import materialized, product

ROUND_OFF = 4.0
"""What is not more than so many times the round-off of the numbers that it was computed from says nothing."""
TOGETHER = 32
"""Pairs of points that a function is evaluated at together."""


@runtime_checkable
class PointSet(Protocol):
    """The constants of a sigma-point rule in `n` dimensions; row 0 is the centre, whatever its weight.

    The function values `Y` (one row a point) give mean `Y₀ + mean·D`, Φᵀ = `slope D` and Eᵀ = `residual D` with
    `D = Y − Y₀`. The centre's own column drops out, because `D₀ = 0`.
    """

    @property
    def points(self) -> Float[np.ndarray, "p n"]:
        """One row each."""
        ...

    @property
    def mean(self) -> Float[np.ndarray, " p"]:
        """Their weights."""
        ...

    @property
    def slope(self) -> Float[np.ndarray, "n p"]: ...

    @property
    def residual(self) -> Float[np.ndarray, "k p"]: ...

    @property
    def centre(self) -> float:
        """The weight of the centre."""
        ...

    @property
    def reach(self) -> float:
        """How far out the points are, in standard deviations."""
        ...

    def values(self, g: Callable[[Array], Array], factor: Float[Array, "n N"]) -> Float[Array, "p d"]:
        """Those of `g(factor ξ)` at the points."""
        ...

    def projected(self, D: Float[Array, "q d"]) -> tuple[Float[Array, " d"], Float[Array, "n d"], Float[Array, "k d"]]:
        """Shift of the mean, Φᵀ and Eᵀ from the differences to the centre's value, of all other points."""
        ...

    def large(self, scale: Float[Array, " d"]) -> Float[Array, "k d"]:
        """`Linearization.large` for function values of size `scale`."""
        ...


class SigmaPoints(NamedTuple):
    """A `PointSet` of any kind."""

    points: Float[np.ndarray, "p n"]
    mean: Float[np.ndarray, " p"]
    slope: Float[np.ndarray, "n p"]
    residual: Float[np.ndarray, "k p"]

    @property
    def centre(self) -> float:
        return float(self.mean[0])

    @property
    def reach(self) -> float:
        return float(abs(self.points).max())

    def values(self, g: Callable[[Array], Array], factor: Float[Array, "n N"]) -> Float[Array, "p d"]:
        return jax.vmap(g)(product(jnp.asarray(self.points, factor.dtype), factor.T))

    def projected(self, D: Float[Array, "q d"]) -> tuple[Float[Array, " d"], Float[Array, "n d"], Float[Array, "k d"]]:
        shift, slope, residual = (
            product(jnp.asarray(np.atleast_2d(c)[:, 1:], D.dtype), D) for c in (self.mean, self.slope, self.residual)
        )
        return shift[0], slope, residual

    def large(self, scale: Float[Array, " d"]) -> Float[Array, "k d"]:
        return jnp.asarray(_round_off(np.abs(self.residual).sum(axis=1))[:, None], scale.dtype) * scale[None, :]


class SymmetricPoints(NamedTuple):
    """A `PointSet` at ± `spread` along each axis, with the weight 1/(2 `spread`²), whose even parts give E.

    With Dᵢ± the differences at ±ξᵢ: Φᵢ = √(w/2) (Dᵢ₊ − Dᵢ₋) and
    Eᵢ = even·√(w/2) (Dᵢ₊ + Dᵢ₋) + mixed·Σⱼ √(w/2) (Dⱼ₊ + Dⱼ₋).

    Sums and differences of pairs take the place of products, and nothing here is larger than the points themselves.
    """

    n: int
    spread: float
    even: float
    mixed: float

    @property
    def _root(self) -> float:
        return 0.5 / self.spread

    @property
    def points(self) -> Float[np.ndarray, "p n"]:
        axes = self.spread * np.eye(self.n)
        return np.concatenate([np.zeros((1, self.n)), axes, -axes])

    @property
    def mean(self) -> Float[np.ndarray, " p"]:
        return np.append(self.centre, np.full(2 * self.n, 0.5 / self.spread**2))

    @property
    def slope(self) -> Float[np.ndarray, "n p"]:
        eye = np.eye(self.n)
        return _behind_centre(self._root * np.hstack([eye, -eye]))

    @property
    def residual(self) -> Float[np.ndarray, "k p"]:
        E = self.even * np.eye(self.n) + self.mixed
        return _behind_centre(self._root * np.hstack([E, E]))

    @property
    def centre(self) -> float:
        return 1 - self.n / self.spread**2

    @property
    def reach(self) -> float:
        return self.spread

    def values(self, g: Callable[[Array], Array], factor: Float[Array, "n N"]) -> Float[Array, "p d"]:
        if self.n > TOGETHER:
            return self._in_parts(g, factor)
        along = self.spread * factor.T
        return jax.vmap(g)(jnp.concatenate([jnp.zeros_like(along[:1]), along, -along]))

    def _in_parts(self, g: Callable[[Array], Array], factor: Float[Array, "n N"]) -> Float[Array, "p d"]:
        """Not at all points at once, which have more numbers in them than all else; the last part overlaps."""
        rows = factor.T
        centre = g(jnp.zeros_like(rows[0]))

        def part(i: Array, values: Array) -> Array:
            start = jnp.minimum(i * TOGETHER, self.n - TOGETHER)
            along = self.spread * jax.lax.dynamic_slice_in_dim(rows, start, TOGETHER)
            both = jax.vmap(g)(jnp.concatenate([along, -along])).reshape(2, TOGETHER, -1)
            return jax.lax.dynamic_update_slice(values, both, (0, start, 0))

        nothing = jnp.zeros((2, self.n, centre.shape[0]), centre.dtype)
        values = jax.lax.fori_loop(0, -(-self.n // TOGETHER), part, nothing)
        return jnp.concatenate([centre[None], values.reshape(2 * self.n, -1)])

    def projected(self, D: Float[Array, "q d"]) -> tuple[Array, Array, Array]:
        ahead, behind = D[: self.n], D[self.n :]
        sums = materialized(self._root * (ahead + behind))
        total = materialized(jnp.sum(sums, axis=0))
        residual = self.even * sums + self.mixed * total[None, :] if self.mixed else self.even * sums
        return total / self.spread, self._root * (ahead - behind), residual

    def large(self, scale: Float[Array, " d"]) -> Float[Array, "k d"]:
        n, one = self.n, abs(self.even + self.mixed) + (self.n - 1) * abs(self.mixed)
        reach = 2 * self._root * (one + abs(self.even + n * self.mixed))
        return jnp.broadcast_to(_round_off(reach) * scale, (n, *scale.shape))


def _round_off(reach: Any) -> Any:
    """The size from which on a sum has no digits for the round-off of terms of size one, weighted by `reach` in all."""
    return 2 * ROUND_OFF * reach


def from_weights(
    points: Float[np.ndarray, "p n"], weights: Float[np.ndarray, " p"], excess: float = 0.0
) -> SigmaPoints:
    """The constants of a set with weights, where Cov = Σᵢ wᵢ (Yᵢ−Y₀)(Yᵢ−Y₀)ᵀ + (excess − 1) μ μᵀ, μ = Σᵢ wᵢ (Yᵢ−Y₀).

    Args:
        points: row 0 is the centre (zero); the others have Σ wξ = 0 and Σ wξξᵀ = I.
        weights: of all points; that of the centre is implied (any real number), the others are positive.
        excess: 0 is the mean-centred covariance of a probability rule. A scaled rule has `excess = 1 + β − α²`.

    Derivation: in D̃ᵢ = √wᵢ (Yᵢ−Y₀) the covariance is D̃ᵀ (I + (excess−1) v vᵀ) D̃ with v = √w and |v|² = s = Σᵢ wᵢ. The
    directions `√w ξ_j` carry Φ; they are orthogonal to v. What remains is scaled along v by c² = 1 + (excess−1) s. So
    the covariance is positive semi-definite, and E real, exactly where c² ≥ 0: also with a negative centre weight.

    Raises:
        ValueError: where c² < 0.
    """
    w = np.sqrt(weights[1:])
    s = float(weights[1:].sum())
    c2 = 1.0 + (excess - 1.0) * s
    if c2 < -1e-12:
        raise ValueError(
            f"these sigma points give a covariance that is not positive semi-definite in {points.shape[1]} dimensions: "
            f"1 + (excess - 1) * (sum of the outer weights) is {c2:.3g}; a larger beta, which raises excess, mends it"
        )
    phi = w[:, None] * points[1:]
    v = w / np.sqrt(s)
    rest = np.eye(len(w)) - phi @ phi.T + (np.sqrt(max(c2, 0.0)) - 1.0) * np.outer(v, v)
    E = _compressed(rest)
    E = E - (E @ phi) @ phi.T  # what the decomposition's round-off has left of the slope is multiplied by large values
    return SigmaPoints(points, weights, _behind_centre(phi.T * w), _behind_centre(E * w))


def _behind_centre(rows: np.ndarray) -> np.ndarray:
    return np.concatenate([-rows.sum(axis=1, keepdims=True), rows], axis=1)


def _compressed(rows: np.ndarray) -> np.ndarray:
    """As many rows as the rank, with the same Gram matrix."""
    _, sizes, directions = np.linalg.svd(rows)
    keep = sizes > 1e-9 * max(1.0, sizes.max(initial=0.0))
    return sizes[keep, None] * directions[keep]
