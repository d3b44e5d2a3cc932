"""What every rule returns, and what every sigma-point rule is made of.

A rule looks at a function `g` of a standard normal vector `ξ` and writes it as

    g(ξ) ≈ ȳ + Φ ξ + E ε,      ε ~ N(0, I) independent of ξ,

so that `P_yy = Φ Φᵀ + E Eᵀ`, and the cross-covariance with `x = m + L ξ` is `P_xy = L Φᵀ`.

For a sigma-point rule all three are *fixed linear maps of the function values at fixed points*. Such a rule is
therefore four constant arrays that depend on the dimension alone (`SigmaPoints`), and a new rule is a function that
fills them in. With non-negative weights `w`, `√w` and the rows `√w ξ_j` are orthonormal for every rule that is exact to
second degree; the mean and Φ are the projections on them, and E is what is left, in any orthonormal basis.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint.linalg import solve_upper
from sigmapoint.native import materialized, product
from sigmapoint.spaces import Space

ROUND_OFF = 4.0
"""What is not more than so many times the round-off of the numbers that it was computed from says nothing."""


class Linearization(NamedTuple):
    """`g(ξ) ≈ mean + slope ξ + residual ε` (in the output's space: `mean` is a point, the rest are differences)."""

    mean: Float[Array, " d"]
    slope: Float[Array, "c n"]
    residual: Float[Array, "c k"]
    scale: Float[Array, " c"]
    """size of the numbers it was computed from: what is below their round-off is not there"""
    large: Float[Array, "c k"]
    """numbers so large that in their sum with `residual` there are no digits for its round-off"""

    @property
    def bend(self) -> Float[Array, "c k"]:
        """`residual` without what is mere round-off of the numbers that it was computed from.

        A second difference of a function that is straight is not zero but some round-off of its values. Beside a small
        variance that would count as noise: in 32 bits, values of 1e4 would add a standard deviation of 1e-3. (Where
        covariances are added up, as in the dense form, their own round-off is larger.)
        """
        return (self.residual + self.large) - self.large


class Pairs(NamedTuple):
    """What a symmetric set comes down to: see `paired`. Sums and differences of pairs take the place of products."""

    spread: float
    weight: float
    even: float
    mixed: float

    def displaced(self, factor: Float[Array, "n N"]) -> Float[Array, "p n"]:
        along = self.spread * factor.T
        return jnp.concatenate([jnp.zeros_like(along[:1]), along, -along])

    def projected(self, D: Float[Array, "q d"]) -> tuple[Array, Array, Array]:
        ahead, behind = D[: D.shape[0] // 2], D[D.shape[0] // 2 :]
        root = (self.weight / 2) ** 0.5
        sums = materialized(root * (ahead + behind))
        total = materialized(jnp.sum(sums, axis=0))
        residual = self.even * sums + self.mixed * total[None, :] if self.mixed else self.even * sums
        return 2 * root * total, root * (ahead - behind), residual


class SigmaPoints(NamedTuple):
    """The constants of a sigma-point rule in `n` dimensions; row 0 is the centre, whatever its weight.

    The function values `Y` (one row a point) give mean `Y₀ + mean·D`, Φᵀ = `slope D` and Eᵀ = `residual D` with
    `D = Y − Y₀`. The centre's own column drops out, because `D₀ = 0`.
    """

    points: Float[np.ndarray, "p n"]
    mean: Float[np.ndarray, " p"]
    slope: Float[np.ndarray, "n p"]
    residual: Float[np.ndarray, "k p"]
    pairs: Pairs | None = None
    """the same, where the points are symmetric pairs along the axes"""

    def displaced(self, factor: Float[Array, "n N"]) -> Float[Array, "p n"]:
        """The points as displacements of a vector with this square root of its covariance."""
        return self.pairs.displaced(factor) if self.pairs else product(jnp.asarray(self.points, factor.dtype), factor.T)

    def projected(self, D: Float[Array, "q d"]) -> tuple[Float[Array, " d"], Float[Array, "n d"], Float[Array, "k d"]]:
        """Shift of the mean, Φᵀ and Eᵀ from the differences to the centre's value, of all other points."""
        if self.pairs:
            return self.pairs.projected(D)
        shift, slope, residual = (
            product(jnp.asarray(np.atleast_2d(c)[:, 1:], D.dtype), D) for c in (self.mean, self.slope, self.residual)
        )
        return shift[0], slope, residual

    def large(self, scale: Float[Array, " d"]) -> Float[Array, "k d"]:
        """`Linearization.large` for function values of size `scale`."""
        reach = np.abs(self.residual).sum(axis=1, keepdims=True)
        return jnp.asarray(2 * ROUND_OFF * reach, scale.dtype) * scale[None, :]


@runtime_checkable
class Rule(Protocol):
    """How a function of a Gaussian vector is linearised."""

    def __call__(self, g: Callable[[Array], Array], factor: Float[Array, "n N"], space: Space) -> Linearization:
        """Linearise `g(factor ξ)` in ξ ~ N(0, I); `space` is that of g's values."""
        ...

    def about(
        self,
        g: Callable[[Array], Array],
        mean: Float[Array, " n"],
        factor: Float[Array, "n n"],
        space: Space,
    ) -> Linearization:
        """Linearise `g` about N(mean, factor factorᵀ), with the slope in g's own argument."""
        ...


@dataclass(frozen=True)
class SigmaPointRule(ABC):
    """A rule from function values alone. A subclass says which constants, in `sigma_points`."""

    @abstractmethod
    def sigma_points(self, n: int) -> SigmaPoints:
        """The constants in `n` dimensions; ValueError where the parameters do not work."""

    def __call__(self, g: Callable[[Array], Array], factor: Float[Array, "n N"], space: Space) -> Linearization:
        N = factor.shape[1]
        return self.combine(jax.vmap(g)(self.constants(N).displaced(factor)), N, space)

    def about(
        self,
        g: Callable[[Array], Array],
        mean: Float[Array, " n"],
        factor: Float[Array, "n n"],
        space: Space,
    ) -> Linearization:
        # No narrower than differences can resolve: a direction known exactly would otherwise leave no slope to see.
        narrow = jnp.finfo(factor.dtype).eps ** (1 / 3) - jnp.diagonal(factor)
        factor = factor + jnp.diag(jnp.maximum(narrow, 0.0))
        lin = self(lambda step: g(mean + step), factor, space)
        slope = solve_upper(factor, lin.slope.T).T
        return lin._replace(slope=slope, scale=lin.scale / jnp.min(jnp.diagonal(factor)))

    def combine(self, values: Float[Array, "p d"], n: int, space: Space) -> Linearization:
        """The linearisation from the function values at the points of dimension `n`."""
        constants = self.constants(n)
        D = jax.vmap(space.residual, (0, None))(values[1:], values[0])
        shift, slope, residual = constants.projected(materialized(D))
        scale = jax.lax.stop_gradient(magnitude(values, slope.shape[1], n))
        return Linearization(space.retract(values[0], shift), slope.T, residual.T, scale, constants.large(scale).T)

    def constants(self, n: int) -> SigmaPoints:
        """`sigma_points(n)`, remembered."""
        return _remembered(self, n)


@lru_cache(maxsize=512)
def _remembered(rule: SigmaPointRule, n: int) -> SigmaPoints:
    return rule.sigma_points(n)


def magnitude(values: Float[Array, "p d"], size: int, n: int = 0) -> Float[Array, " c"]:
    """How large values are, in each element: 1 to √(2n+1) times the largest at a symmetric set in n dimensions.

    That of all elements together where a difference (of `size`) has other elements than a value.
    """
    squares = (2 * n + 1) / values.shape[0] * jnp.sum(values**2, axis=0)
    squares = squares if squares.shape[0] == size else jnp.full(size, jnp.sum(squares))
    return jnp.sqrt(jnp.minimum(squares, jnp.finfo(values.dtype).max))


def symmetric_points(n: int, spread: float) -> Float[np.ndarray, "p n"]:
    """The centre and `± spread` along each axis: 0, +e₁ … +eₙ, −e₁ … −eₙ."""
    axes = spread * np.eye(n)
    return np.concatenate([np.zeros((1, n)), axes, -axes])


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
    return SigmaPoints(points, weights, _behind_centre(phi.T * w), _behind_centre(_compressed(rest) * w))


def paired(
    points: Float[np.ndarray, "p n"], weights: Float[np.ndarray, " p"], even: float, mixed: float
) -> SigmaPoints:
    """The constants of a symmetric set (`symmetric_points`) whose even parts give E.

    With Dᵢ± the differences at ±ξᵢ: Φᵢ = √(w/2) (Dᵢ₊ − Dᵢ₋) and
    Eᵢ = even·√(w/2) (Dᵢ₊ + Dᵢ₋) + mixed·Σⱼ √(w/2) (Dⱼ₊ + Dⱼ₋).
    """
    n = points.shape[1]
    root = np.sqrt(weights[1] / 2)
    eye = np.eye(n)
    E = even * eye + mixed
    return SigmaPoints(
        points,
        weights,
        _behind_centre(root * np.hstack([eye, -eye])),
        _behind_centre(root * np.hstack([E, E])),
        Pairs(float(points[1, 0]), float(weights[1]), float(even), float(mixed)),
    )


def _behind_centre(rows: np.ndarray) -> np.ndarray:
    return np.concatenate([-rows.sum(axis=1, keepdims=True), rows], axis=1)


def _compressed(rows: np.ndarray) -> np.ndarray:
    """As many rows as the rank, with the same Gram matrix."""
    _, sizes, directions = np.linalg.svd(rows)
    keep = sizes > 1e-9 * max(1.0, sizes.max(initial=0.0))
    return sizes[keep, None] * directions[keep]
