"""Unknown parameters of a model: any pytree, seen by the estimators as a vector z with a Gaussian prior.

A parameter that is bound to a range is a monotone function of its element of z, so that quantiles go through it as they
are: an interval of z is one of the parameter. Elements of z have a prior of mean 0 and variance 1, in whatever units
the parameters are: 1e-9 beside 1e6 is no matter. (With `sp.Gaussian` in place of a pytree, z is the vector itself.)
"""

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.noise import Gaussian
from sigmapoint.results import Posterior
from sigmapoint.step import FilterState

BAR = 2.0
"""Standard deviations to either end of an interval."""


@runtime_checkable
class Range(Protocol):
    """Where a parameter can be: a monotone function of what is unbounded, and what that is close to a value."""

    def value(self, center: Array, std: Array, z: Array) -> Array:
        """The parameter at `z`: `center` at 0, and from there on about `std` for each unit."""
        ...


@dataclass(frozen=True)
class Real:
    """Anywhere."""

    def value(self, center: Array, std: Array, z: Array) -> Array:
        return center + std * z


@dataclass(frozen=True)
class Positive:
    """Above zero, by the exponential."""

    def value(self, center: Array, std: Array, z: Array) -> Array:
        return center * jnp.exp(std / center * z)


@dataclass(frozen=True)
class Bounded:
    """Between two numbers, by the logistic function."""

    low: float
    high: float

    def value(self, center: Array, std: Array, z: Array) -> Array:
        part = (center - self.low) / (self.high - self.low)
        slope = std / (self.high - self.low) / (part * (1 - part))
        return self.low + (self.high - self.low) * jax.nn.sigmoid(jax.scipy.special.logit(part) + slope * z)


class Unknown(eqx.Module):
    """One unknown parameter, of any shape; made by `real`, `positive` or `bounded`."""

    center: Float[Array, "..."]
    std: Float[Array, "..."]
    range: Range = eqx.field(static=True)


def real(value: Any, std: Any) -> Unknown:
    """An unknown parameter that may be any number.

    Args:
        value: what it is thought to be, a number or an array, in its own units.
        std: how far off that may be, in the same units: one number, or one for each element.

    Raises:
        ValueError: values that are not finite, a deviation that is not positive.

    Examples:
        >>> import sigmapoint as sp
        >>> float(sp.real(2.0, 0.5).std)
        0.5
    """
    return _unknown(value, std, Real(), -np.inf, np.inf)


def positive(value: Any, std: Any) -> Unknown:
    """An unknown parameter that is greater than zero: its logarithm is Gaussian, with deviation `std / value`.

    Args:
        value: what it is thought to be (the median of the prior), a number or an array, in its own units.
        std: how far off that may be, in the same units: one number, or one for each element.

    Raises:
        ValueError: values that are not positive or not finite, a deviation that is not positive.

    Examples:
        >>> import sigmapoint as sp
        >>> float(sp.positive(0.02, 0.01).center)
        0.02
    """
    return _unknown(value, std, Positive(), 0.0, np.inf)


def bounded(value: Any, std: Any, low: float, high: float) -> Unknown:
    """An unknown parameter between two numbers.

    Args:
        value: what it is thought to be (the median of the prior), a number or an array, in its own units.
        std: how far off that may be, in the same units, where the bounds are far: one number, or one for each element.
        low: where it ends.
        high: where it ends.

    Raises:
        ValueError: values that are not between the bounds, a deviation that is not positive.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.bounded(0.9, 0.05, low=0.0, high=1.0).range
        Bounded(low=0.0, high=1.0)
    """
    low, high = checks.number("low", low), checks.number("high", high)
    return _unknown(value, std, Bounded(low, high), low, high)


def _unknown(value: Any, std: Any, range: Range, low: float, high: float) -> Unknown:
    center = checks.array("value", value)
    std = checks.array("std", std).astype(center.dtype)
    try:
        std = jnp.broadcast_to(std, center.shape)
    except ValueError:
        raise ValueError(f"std of shape {std.shape} does not fit a value of shape {center.shape}") from None
    checks.finite("value", center)
    checks.finite("std", std)
    if checks.known(center) and not ((np.asarray(center) > low) & (np.asarray(center) < high)).all():
        raise ValueError(f"value must be between {low:g} and {high:g}, got {np.asarray(center).tolist()}")
    if checks.known(std) and not (np.asarray(std) > 0).all():
        raise ValueError(f"std must be greater than zero, got {np.asarray(std).tolist()}; what is known is no unknown")
    return Unknown(center, std, range)


class Unknowns(eqx.Module):
    """All unknown parameters of a model, as one vector."""

    prior: Gaussian
    """of z"""
    tree: Any
    """the parameters at z"""
    names: tuple[str, ...] = eqx.field(static=True)
    """of the elements of z"""

    @classmethod
    def of(cls, theta: Any) -> "Unknowns":
        """From a `Gaussian` over a vector, or a pytree of unknowns; a number in it is one of its own size.

        Raises:
            ValueError: nothing that is unknown.
        """
        if isinstance(theta, Gaussian):
            L = theta.mean.shape[0]
            if theta.cov.shape != (L, L):
                raise ValueError(f"theta must have a covariance ({L}, {L}), got shape {theta.cov.shape}")
            return cls(theta, _Vector(), tuple(f"theta{i}" for i in range(L)))
        theta = jax.tree.map(_of_its_size, theta, is_leaf=_is_unknown)
        unknowns, rest = eqx.partition(theta, _is_unknown, is_leaf=_is_unknown)
        found = jax.tree_util.tree_leaves_with_path(unknowns, is_leaf=_is_unknown)
        if not sum(leaf.center.size for _, leaf in found):
            raise ValueError(
                "theta has no unknown parameters: it must be a sp.Gaussian, or a pytree with sp.real(), sp.positive(), "
                "sp.bounded() or numbers in it"
            )
        dtype = jnp.result_type(*(leaf.center.dtype for _, leaf in found))
        L = sum(leaf.center.size for _, leaf in found)
        names = tuple(name for path, leaf in found for name in _names(path, leaf.center.shape))
        return cls(Gaussian(jnp.zeros(L, dtype), jnp.eye(L, dtype=dtype)), _Tree(unknowns, rest), names)

    @property
    def size(self) -> int:
        """Number of elements of z."""
        return self.prior.mean.shape[0]

    def values(self, z: Float[Array, " L"]) -> Float[Array, " L"]:
        """The parameters at z in their own units, one after the other, as they are named."""
        return self.tree.values(z)


class _Vector(eqx.Module):
    """z is the parameters."""

    def __call__(self, z: Float[Array, " L"]) -> Array:
        return z

    def values(self, z: Float[Array, " L"]) -> Float[Array, " L"]:
        return z


class _Tree(eqx.Module):
    """z as a pytree of parameters."""

    unknowns: Any
    rest: Any

    def __call__(self, z: Float[Array, " L"]) -> Any:
        return eqx.combine(self._unknowns(z), self.rest)

    def values(self, z: Float[Array, " L"]) -> Float[Array, " L"]:
        return jnp.concatenate([jnp.ravel(leaf).astype(z.dtype) for leaf in jax.tree.leaves(self._unknowns(z))])

    def _unknowns(self, z: Float[Array, " L"]) -> Any:
        taken = 0

        def leaf(unknown: Unknown) -> Array:
            nonlocal taken
            part = z[taken : taken + unknown.center.size].reshape(unknown.center.shape)
            taken += unknown.center.size
            return unknown.range.value(unknown.center, unknown.std, part)

        return jax.tree.map(leaf, self.unknowns, is_leaf=_is_unknown)


def _is_unknown(a: Any) -> bool:
    return isinstance(a, Unknown)


def _of_its_size(a: Any) -> Any:
    number = isinstance(a, int | float) and not isinstance(a, bool)
    if not number and not eqx.is_inexact_array(a) and not (isinstance(a, np.ndarray) and a.dtype.kind == "f"):
        return a
    value = checks.array("theta", a)
    return real(value, jnp.where(value == 0, 1.0, jnp.abs(value)))


def _names(path: Any, shape: tuple[int, ...]) -> list[str]:
    name = jax.tree_util.keystr(path, simple=True, separator=".") or "theta"
    return [name] if not shape else [name + "".join(f"[{i}]" for i in at) for at in np.ndindex(*shape)]


class Estimates(NamedTuple):
    """What is known of parameters, each field a pytree like them; with a leading axis where that changes with time."""

    value: Any
    """the median, in the parameters' own units"""
    std: Any
    """half the width of the central 68 %: of a Gaussian, its standard deviation"""
    low: Any
    """where the central 95 % (two standard deviations of a Gaussian) begin"""
    high: Any
    """where they end"""

    @classmethod
    def of(cls, unknowns: Unknowns, mean: Float[Array, "*T L"], std: Float[Array, "*T L"]) -> "Estimates":
        """From beliefs about z; where a deviation is NaN, the value alone is known."""
        flat_mean, flat_std = mean.reshape(-1, mean.shape[-1]), std.reshape(-1, std.shape[-1])
        lead = mean.shape[:-1]

        def at(distance: float) -> Any:
            z = flat_mean + distance * flat_std if distance else flat_mean
            found = jax.vmap(unknowns.tree, out_axes=0)(z)
            return jax.tree.map(lambda a: jnp.reshape(a, (*lead, *jnp.shape(a)[1:])), found)

        half = jax.tree.map(lambda above, below: (above - below) / 2, at(1.0), at(-1.0))
        return cls(at(0.0), half, at(-BAR), at(BAR))


def estimates(theta: Any, post: Posterior | FilterState) -> Estimates:
    """What a result of `joint` says of the parameters, in their own units.

    Args:
        theta: as given to `joint`.
        post: what `filter`, `smooth` or `batch` made of its model, with `mean` and `std` kept; or a state of `online`.

    Returns:
        `Estimates`: value, standard deviation and a 95 % interval, each a pytree like the parameters; of a series, its
        leaves have a leading axis T.

    Raises:
        ValueError: a result without `mean` and `std`, or with fewer states than there are parameters.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> def build(theta):
        ...     return sp.StateSpaceModel(lambda x, u: theta["a"] * x, lambda x, u: x, 0.01 * jnp.eye(1),
        ...                               0.01 * jnp.eye(1), sp.Gaussian(jnp.ones(1), jnp.eye(1)))
        >>> theta = {"a": sp.bounded(0.5, 0.3, low=0.0, high=1.0)}
        >>> post = sp.filter(sp.joint(build, theta), 0.9 ** jnp.arange(50.0)[:, None])
        >>> found = sp.estimates(theta, post)
        >>> bool(found.low["a"][-1] < 0.9 < found.high["a"][-1])
        True
    """
    unknowns = Unknowns.of(theta)
    if post.mean is None or post.std is None:
        raise ValueError("estimates: the result has no mean or no std: filter with both among keep=")
    if post.std.shape[-1] < unknowns.size:
        raise ValueError(f"estimates: {unknowns.size} parameters in a result of {post.std.shape[-1]} states")
    return Estimates.of(unknowns, post.mean[..., -unknowns.size :], post.std[..., -unknowns.size :])
