"""Noise: a Gaussian, how it enters a function, and how it varies with time.

Additive noise can stay outside the sigma points (`rest`); noise inside a function always needs coordinates `ξ` of its
own. That is decided here, once, by the two kinds; no filter asks which it is.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.belief import Spread
from sigmapoint.native import applied
from sigmapoint.spaces import Space


class Gaussian(eqx.Module):
    """A Gaussian, as the initial belief or as a noise.

    Args:
        mean: (n,), in the units of the state.
        cov: covariance (n, n), symmetric and positive semi-definite, in products of these units.

    Raises:
        ValueError: a shape that does not fit, a covariance that is not symmetric or not positive semi-definite, NaN.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> sp.Gaussian(jnp.zeros(2), jnp.eye(2)).cov.shape
        (2, 2)
    """

    mean: Float[Array, "*T n"]
    cov: Float[Array, "*T c c"]

    def __init__(self, mean: Any, cov: Any):
        self.mean = checks.array("mean", mean)
        self.cov = checks.array("cov", cov)
        checks.covariance("cov", self.cov)
        if self.mean.ndim != 1:
            raise ValueError(f"mean must be (n,), got shape {self.mean.shape}")
        checks.finite("mean", self.mean)


class Entry(NamedTuple):
    """How a noise enters a function: through `size` coordinates ξ of the points, the `rest` added afterwards."""

    size: int
    call: Callable[[Array, Any, Array], Array]
    rest: Spread | None


@runtime_checkable
class Noise(Protocol):
    """A noise at one instant, as the filters see it."""

    def within(self, f: Callable[..., Any], space: Space) -> Entry:
        """`f` with as little noise in the points as possible."""
        ...

    def through(self, f: Callable[..., Any], space: Space) -> Entry:
        """`f` with all of the noise in the points."""
        ...


class AdditiveNoise(NamedTuple):
    """`f(x, u) + w`, `w ~ N(mean, spread)`."""

    mean: Float[Array, " q"]
    spread: Spread

    def within(self, f: Callable[..., Any], space: Space) -> Entry:
        return Entry(0, lambda x, u, xi: space.retract(f(x, u), self.mean), self.spread)

    def through(self, f: Callable[..., Any], space: Space) -> Entry:
        def call(x: Array, u: Any, xi: Array) -> Array:
            return space.retract(f(x, u), self.mean + applied(self.spread.factor, xi))

        return Entry(self.mean.shape[0], call, None)


class StackedNoise(NamedTuple):
    """`f(x, u, w)`, `w ~ N(mean, spread)`."""

    mean: Float[Array, " q"]
    spread: Spread

    def within(self, f: Callable[..., Any], space: Space) -> Entry:
        return self.through(f, space)

    def through(self, f: Callable[..., Any], space: Space) -> Entry:
        return Entry(self.mean.shape[0], lambda x, u, xi: f(x, u, self.mean + applied(self.spread.factor, xi)), None)


class Additive(eqx.Module):
    """Noise added to a function's value: `f(x, u) + w`. A covariance given in its place means this.

    Args:
        cov: covariance (q, q), or (T, q, q) with one for each instant, in squared units of the value; a `Gaussian`
            gives its mean along with it.
        mean: (q,) or (T, q), in units of the value; zero where not given.
        lasting: the last of the T holds from there on; a longer series is refused otherwise.

    Raises:
        ValueError: a covariance that is not symmetric or not positive semi-definite, a mean of another size, NaN.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> biased = sp.Additive(0.01 * jnp.eye(2), mean=jnp.array([0.1, 0.0]))
        >>> biased.cov.shape, biased.mean.shape
        ((2, 2), (2,))
    """

    mean: Float[Array, "*T q"]
    cov: Float[Array, "*T q q"]
    lasting: bool = eqx.field(static=True)

    def __init__(self, cov: Any, mean: Any = None, *, lasting: bool = False):
        self.cov, self.mean = _noise_arrays(cov, mean)
        self.lasting = lasting

    kind = AdditiveNoise

    def fits(self, name: str, size: int, what: str) -> None:
        """Raise where the covariance has not the size of what it is added to."""
        if self.cov.shape[-1] != size:
            raise ValueError(
                f"{name} must be ({size}, {size}) or (T, {size}, {size}) for a {what} of {size} element(s), got shape "
                f"{self.cov.shape}; for noise that enters otherwise use sp.NonAdditive(cov)"
            )


class NonAdditive(eqx.Module):
    """Noise as a third argument, `f(x, u, w)`: covariance (q, q), or (T, q, q) with one for each instant, and a mean.

    Args:
        cov: covariance of the noise; its size q is that of the argument `w`. A `Gaussian` gives its mean along with it.
        mean: its mean (q,) or (T, q); zero where not given.
        lasting: the last of the T holds from there on; a longer series is refused otherwise.

    Raises:
        ValueError: a covariance that is not symmetric or not positive semi-definite, a mean of another size, NaN.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(
        ...     dynamics=lambda x, u, w: x * jnp.exp(w), observation=lambda x, u: x,
        ...     process_noise=sp.NonAdditive(0.01 * jnp.eye(1)), observation_noise=jnp.eye(1),
        ...     initial=sp.Gaussian(jnp.ones(1), jnp.eye(1)))
    """

    mean: Float[Array, "*T q"]
    cov: Float[Array, "*T q q"]
    lasting: bool = eqx.field(static=True)

    def __init__(self, cov: Any, mean: Any = None, *, lasting: bool = False):
        self.cov, self.mean = _noise_arrays(cov, mean)
        self.lasting = lasting

    kind = StackedNoise

    def fits(self, name: str, size: int, what: str) -> None:
        """Any size fits: the model's function says how the noise enters."""


def noise_of(name: str, noise: Any) -> Additive | NonAdditive:
    """As given by a user: a covariance or a `Gaussian` is additive noise.

    Raises:
        ValueError: as these, with the name of the argument.
    """
    if isinstance(noise, Additive | NonAdditive):
        return noise
    if isinstance(noise, Gaussian):
        return Additive(noise)
    cov = checks.array(name, noise)
    checks.covariance(name, cov, series=True)
    return Additive(cov)


class NoiseSeries(NamedTuple):
    """A noise made ready for a run: factored once, looked up by instant."""

    kind: type
    mean: Float[Array, "*T q"]
    spread: Spread

    @classmethod
    def of(cls, noise: Additive | NonAdditive, dtype: Any) -> "NoiseSeries":
        cov = noise.cov.astype(dtype)
        spread = jax.vmap(Spread.of)(cov) if cov.ndim == 3 else Spread.of(cov)
        return cls(noise.kind, noise.mean.astype(dtype), spread)

    def at(self, k: Array) -> Noise:
        """The noise at instant `k`; past the end of a time-varying one, its last."""
        mean = self.mean[k] if self.mean.ndim == 2 else self.mean
        spread = jax.tree.map(lambda a: a[k], self.spread) if self.spread.cov.ndim == 3 else self.spread
        return self.kind(mean, spread)


def _noise_arrays(cov: Any, mean: Any) -> tuple[Array, Array]:
    if isinstance(cov, Gaussian):
        cov, mean = cov.cov, cov.mean
    cov = checks.array("cov", cov)
    checks.covariance("cov", cov, series=True)
    mean = jnp.zeros(cov.shape[-1:], cov.dtype) if mean is None else checks.array("mean", mean)
    checks.finite("mean", mean)
    if mean.shape[-1:] != cov.shape[-1:] or mean.ndim > 2:
        raise ValueError(f"mean of a noise must be ({cov.shape[-1]},) as its covariance, got shape {mean.shape}")
    return cov, mean
