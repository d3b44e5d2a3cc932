"""Noise as users give it: a Gaussian, a covariance that may change with time, or a distribution."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.checks import belief_checks
from sigmapoint.distributions import Distribution, moments, size_of
from sigmapoint.entering import AdditiveNoise, StackedNoise


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
    distribution: Any
    """what these are the moments of, where that is another; given to a model, not here"""

    def __init__(self, mean: Any, cov: Any, distribution: Any = None):
        self.distribution = distribution
        self.mean = checks.array("mean", mean)
        self.cov = checks.array("cov", cov)
        belief_checks.covariance("cov", self.cov)
        if self.mean.ndim != 1:
            raise ValueError(f"mean must be (n,), got shape {self.mean.shape}")
        checks.finite("mean", self.mean)


class Additive(eqx.Module):
    """Noise added to a function's value: `f(x, u) + w`. A covariance given in its place means this.

    Args:
        cov: covariance (q, q), or (T, q, q) with one for each instant, in squared units of the value; a `Gaussian`
            gives its mean along with it, a distribution both.
        mean: (q,) or (T, q), in units of the value; zero where not given, or the distribution's.
        distribution: what the noise is drawn from, with numpyro's `sample`, `log_prob`, `mean` and `variance`: particle
            filters and `simulate` take its density, Gaussian filters `cov` and `mean`. A Gaussian where not given.
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
    distribution: Any
    lasting: bool = eqx.field(static=True)

    def __init__(self, cov: Any, mean: Any = None, distribution: Any = None, *, lasting: bool = False):
        self.cov, self.mean, self.distribution = _parts(cov, mean, distribution)
        self.lasting = lasting

    kind = AdditiveNoise
    inside = 0
    """coordinates of the points that it needs: it is added afterwards"""

    @property
    def size(self) -> int:
        """Elements of the noise."""
        return self.cov.shape[-1]

    def require_additive(self, name: str, by: str, instead: str) -> None:
        """It is; see `NonAdditive`."""

    def require_density(self, name: str, by: str, instead: str) -> None:
        """Raise where a Gaussian has no density, as its covariance is singular."""
        if self.distribution is None and checks.known(self.cov) and belief_checks.singular(self.cov):
            raise ValueError(
                f"{name} has a singular covariance, and so no density, which {by} needs: {instead}, or give every "
                "element a variance of its own"
            )

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
        cov: covariance of the noise; its size q is that of the argument `w`. A `Gaussian` gives its mean along with it,
            a distribution both.
        mean: its mean (q,) or (T, q); zero where not given, or the distribution's.
        distribution: as for `Additive`.
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
    distribution: Any
    lasting: bool = eqx.field(static=True)

    def __init__(self, cov: Any, mean: Any = None, distribution: Any = None, *, lasting: bool = False):
        self.cov, self.mean, self.distribution = _parts(cov, mean, distribution)
        self.lasting = lasting

    kind = StackedNoise

    @property
    def size(self) -> int:
        """Elements of the noise."""
        return self.cov.shape[-1]

    @property
    def inside(self) -> int:
        """Coordinates of the points that it needs."""
        return self.size

    def require_additive(self, name: str, by: str, instead: str) -> None:
        """Raise: it is inside a function."""
        raise ValueError(f"{name} must be additive for {by}, got sp.NonAdditive: {instead}")

    def require_density(self, name: str, by: str, instead: str) -> None:
        """Raise: what a function makes of a noise has no density that is known."""
        raise ValueError(
            f"{name} must be additive for {by}, which needs its density, got sp.NonAdditive: {instead}, or give the "
            "covariance or the distribution of what it adds"
        )

    def fits(self, name: str, size: int, what: str) -> None:
        """Any size fits: the model's function says how the noise enters."""


def noise_of(name: str, noise: Any) -> Additive | NonAdditive:
    """As given by a user: a covariance, a `Gaussian` or a distribution is additive noise.

    Raises:
        ValueError: as these, with the name of the argument.
    """
    if isinstance(noise, Additive | NonAdditive):
        return noise
    if isinstance(noise, Gaussian | Distribution):
        return Additive(noise)
    cov = checks.array(name, noise)
    belief_checks.covariance(name, cov, series=True)
    return Additive(cov)


def initial_of(given: Any) -> Gaussian:
    """As given by a user: a `Gaussian`, or a distribution, which has its moments.

    Raises:
        ValueError: neither, or a distribution whose variance is infinite.
    """
    if isinstance(given, Gaussian):
        return given
    if not isinstance(given, Distribution):
        raise ValueError(f"initial must be sp.Gaussian(mean, cov) or a distribution, got {type(given).__name__}")
    mean, cov = moments(given)
    checks.finite("initial: the mean of this distribution", mean)
    checks.finite("initial: the variance of this distribution", cov)
    return Gaussian(mean, cov, given)


def _parts(cov: Any, mean: Any, distribution: Any) -> tuple[Array, Array, Any]:
    """Covariance, mean and distribution, each from where it was given."""
    if isinstance(cov, Gaussian):
        distribution = cov.distribution if distribution is None else distribution
        cov, mean = cov.cov, cov.mean
    elif isinstance(cov, Distribution):
        if distribution is not None:
            raise ValueError("cov must be a covariance where distribution is given beside it, got a distribution")
        cov, distribution = None, cov
    if distribution is None:
        return *_noise_arrays(cov, mean), None
    checks.instance("distribution", distribution, Distribution, "an object with sample and log_prob, as of numpyro")
    of_it = moments(distribution)
    mean = of_it.mean if mean is None else mean
    if cov is None:  # may be infinite: Gaussian methods say so
        return of_it.cov, checks.array("mean", mean), distribution
    cov, size = checks.array("cov", cov), size_of(distribution)
    if cov.shape != (size, size):
        raise ValueError(f"cov must be ({size}, {size}) beside a distribution of {size} element(s), got {cov.shape}")
    return *_noise_arrays(cov, jnp.where(jnp.isfinite(mean), mean, 0.0)), distribution


def _noise_arrays(cov: Any, mean: Any) -> tuple[Array, Array]:
    cov = checks.array("cov", cov)
    belief_checks.covariance("cov", cov, series=True)
    mean = jnp.zeros(cov.shape[-1:], cov.dtype) if mean is None else checks.array("mean", mean)
    checks.finite("mean", mean)
    if mean.shape[-1:] != cov.shape[-1:] or mean.ndim > 2:
        raise ValueError(f"mean of a noise must be ({cov.shape[-1]},) as its covariance, got shape {mean.shape}")
    return cov, mean
