"""Spaces in which states and observations live: how to take a difference and how to add one.

Angles and other manifolds enter the filters only here: `residual(a, b)` is the difference `a − b` as a vector, and
`retract(m, d)` moves the point `m` by such a vector, so that `retract(b, residual(a, b)) = a`.
"""

import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float


@runtime_checkable
class Space(Protocol):
    """Anything hashable with a `residual` (difference) and a `retract` (addition)."""

    def residual(self, a: Float[Array, " d"], b: Float[Array, " d"], /) -> Float[Array, " n"]: ...

    def retract(self, point: Float[Array, " d"], step: Float[Array, " n"], /) -> Float[Array, " d"]: ...


@dataclass(frozen=True)
class Euclidean:
    """Ordinary vectors."""

    def residual(self, a: Float[Array, " d"], b: Float[Array, " d"]) -> Float[Array, " d"]:
        return a - b

    def retract(self, point: Float[Array, " d"], step: Float[Array, " d"]) -> Float[Array, " d"]:
        return point + step


@dataclass(frozen=True)
class Angles:
    """Vectors some of whose elements are angles (see `angles`)."""

    indices: tuple[int, ...]
    period: float

    def residual(self, a: Float[Array, " d"], b: Float[Array, " d"]) -> Float[Array, " d"]:
        return self._wrap(a - b)

    def retract(self, point: Float[Array, " d"], step: Float[Array, " d"]) -> Float[Array, " d"]:
        return self._wrap(point + step)

    def _wrap(self, d: Array) -> Array:
        turns = jnp.round(d / self.period)
        angular = jnp.zeros(d.shape, bool).at[jnp.array(self.indices)].set(True)
        return jnp.where(angular, d - self.period * turns, d)


@dataclass(frozen=True)
class Beside:
    """A space of `point` numbers and `step` directions, and an ordinary vector behind it; made by `beside`."""

    space: Space
    point: int
    step: int

    def residual(self, a: Float[Array, " d"], b: Float[Array, " d"]) -> Float[Array, " n"]:
        x = self.space.residual(a[: self.point], b[: self.point])
        return jnp.concatenate([x, a[self.point :] - b[self.point :]])

    def retract(self, point: Float[Array, " d"], step: Float[Array, " n"]) -> Float[Array, " d"]:
        x = self.space.retract(point[: self.point], step[: self.step])
        return jnp.concatenate([x, point[self.point :] + step[self.step :]])


@dataclass(frozen=True)
class Manifold:
    """A space given by its two functions.

    Args:
        residual: `(a, b) -> d`, the difference of two points as a vector; smooth near `d = 0`.
        retract: `(point, d) -> point`, its inverse in the first argument.

    The vector may be shorter than the point (a unit quaternion has 4 elements and 3 degrees of freedom): covariances
    then have the size of the vector.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> positive = sp.Manifold(lambda a, b: jnp.log(a / b), lambda m, d: m * jnp.exp(d))
        >>> float(positive.retract(jnp.array([2.0]), jnp.array([0.0]))[0])
        2.0
    """

    residual: Callable[[Array, Array], Array]
    retract: Callable[[Array, Array], Array]


def angles(*indices: int, period: float = 2 * jnp.pi) -> Angles:
    """Vectors whose elements `indices` are angles: differences are taken the short way round.

    Args:
        indices: positions of the angles in the vector.
        period: a full turn, in the unit of the element: 2π for radians (default), 360 for degrees.

    Raises:
        ValueError: no indices, one that is no whole number, or a period that is not positive.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> bearing = sp.angles(0, period=360.0)
        >>> float(bearing.residual(jnp.array([179.0]), jnp.array([-179.0]))[0])
        -2.0
    """
    if not indices:
        raise ValueError("angles: name at least one element, e.g. sp.angles(0)")
    try:
        positions = tuple(operator.index(i) for i in indices)
    except TypeError as error:
        hint = f"; write sp.angles({', '.join(map(str, indices[0]))})" if isinstance(indices[0], list | tuple) else ""
        raise ValueError(f"angles: positions must be whole numbers, got {indices}{hint}") from error
    if not isinstance(period, int | float) or not period > 0:
        raise ValueError(f"angles: period, a full turn, must be a positive number, got {period!r}")
    return Angles(positions, float(period))


def beside(space: Space, point: int, step: int) -> Space:
    """Points of `space`, of `point` numbers and `step` directions, with ordinary numbers behind them."""
    return space if isinstance(space, Euclidean) else Beside(space, point, step)


def front(space: Space) -> Space:
    """The space of the points in front, before `beside`."""
    return space.space if isinstance(space, Beside) else space


def folded(space: Space, points: Float[Array, "n d"], std: Float[Array, " n"], reach: float) -> Bool[np.ndarray, " n"]:
    """Whether `reach` standard deviations along element i from `points[i]` come back as another step.

    A step along an angle does past half a turn: a sigma point put there stands for another one.
    """
    steps = jnp.diag(reach * std)
    back = jax.vmap(lambda point, step: space.residual(space.retract(point, step), point))(points, steps)
    same = np.isclose(back, steps, rtol=1e-3, atol=1e-6 * float(np.max(std, initial=0.0)))
    return np.asarray(~same.all(1))


def same_elements(space: Space) -> bool:
    """Whether a difference has the elements and the units of the points, as that of vectors and angles has.

    That of a manifold may have others: a rotation of one degree of freedom between two unit vectors of two elements, or
    the logarithm of a ratio.
    """
    return isinstance(front(space), Euclidean | Angles)
