"""The model: what the user writes once and runs through every filter.

    x[k+1] = f(x[k], u[k]) + w[k],      y[k] = h(x[k], u[k]) + v[k]

Row k of measurements, inputs and results belongs to the same instant; `initial` is the belief about x[0] before y[0].
How a noise enters a function is decided here, once, by the two noise kinds: additive noise can stay outside the sigma
points (`rest`), non-additive noise always needs coordinates `ξ` of its own.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.gaussian import Spread
from sigmapoint.spaces import Euclidean, Space


class Gaussian(eqx.Module):
    """A Gaussian: `mean` (n,) and `cov` (n, n), symmetric and positive semi-definite.

    Raises:
        ValueError: a shape that does not fit, a covariance that is not symmetric or not positive semi-definite, NaN.

    Example:
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
        if self.mean.ndim < 1 or self.cov.ndim < 2:
            raise ValueError(f"Gaussian: mean must be (n,) and cov (n, n), got {self.mean.shape} and {self.cov.shape}")
        checks.finite("mean", self.mean)


class Entry(NamedTuple):
    """How a noise enters a function: through `size` coordinates ξ of the points, the `rest` added afterwards."""

    size: int
    call: Callable[[Array, Any, Array], Array]
    rest: Spread | None


@runtime_checkable
class Noise(Protocol):
    """A noise at one instant, as the filters see it."""

    def within(self, f: Callable, space: Space) -> Entry:
        """`f` with as little noise in the points as possible."""
        ...

    def through(self, f: Callable, space: Space) -> Entry:
        """`f` with all of the noise in the points."""
        ...


class AdditiveNoise(NamedTuple):
    """`f(x, u) + w`, `w ~ N(mean, spread)`."""

    mean: Float[Array, " q"]
    spread: Spread

    def within(self, f: Callable, space: Space) -> Entry:
        return Entry(0, lambda x, u, xi: space.retract(f(x, u), self.mean), self.spread)

    def through(self, f: Callable, space: Space) -> Entry:
        def call(x: Array, u: Any, xi: Array) -> Array:
            return space.retract(f(x, u), self.mean + self.spread.factor @ xi)

        return Entry(self.mean.shape[0], call, None)


class StackedNoise(NamedTuple):
    """`f(x, u, w)`, `w ~ N(mean, spread)`."""

    mean: Float[Array, " q"]
    spread: Spread

    def within(self, f: Callable, space: Space) -> Entry:
        return self.through(f, space)

    def through(self, f: Callable, space: Space) -> Entry:
        return Entry(self.mean.shape[0], lambda x, u, xi: f(x, u, self.mean + self.spread.factor @ xi), None)


class Additive(eqx.Module):
    """Noise added to a function's value: covariance (q, q), or (T, q, q) with one for each instant, and a mean."""

    mean: Float[Array, "*T q"]
    cov: Float[Array, "*T q q"]

    def __init__(self, cov: Any, mean: Any = None):
        self.cov, self.mean = _noise_arrays(cov, mean)

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
        cov: covariance of the noise; its size q is that of the argument `w`.
        mean: its mean (q,) or (T, q); zero where not given.

    Example:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(
        ...     dynamics=lambda x, u, w: x * jnp.exp(w), observation=lambda x, u: x,
        ...     process_noise=sp.NonAdditive(0.01 * jnp.eye(1)), observation_noise=jnp.eye(1),
        ...     initial=sp.Gaussian(jnp.ones(1), jnp.eye(1)))
    """

    mean: Float[Array, "*T q"]
    cov: Float[Array, "*T q q"]

    def __init__(self, cov: Any, mean: Any = None):
        self.cov, self.mean = _noise_arrays(cov, mean)

    kind = StackedNoise

    def fits(self, name: str, size: int, what: str) -> None:
        """Any size fits: the model's function says how the noise enters."""


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


class StateSpaceModel(eqx.Module):
    """A nonlinear state-space model, `x[k+1] = f(x[k], u[k]) + w[k]`, `y[k] = h(x[k], u[k]) + v[k]`.

    Args:
        dynamics: `f(x, u) -> x_next` with `x` (n,); `f(x, u, w)` where `process_noise` is `NonAdditive`. Any function
            that JAX can trace, an Equinox module, or `blackbox(...)`.
        observation: `h(x, u) -> y` with `y` (m,); `h(x, u, v)` where `observation_noise` is `NonAdditive`.
        process_noise: covariance (n, n), or (T, n, n) with row k for the step from k to k+1; `NonAdditive(cov)`; or a
            `Gaussian` (additive, with a mean).
        observation_noise: likewise, (m, m) or (T, m, m).
        initial: belief about x[0], before y[0] is seen.
        state_space: where states live: `angles(...)` or a `Manifold`; ordinary vectors where not given.
        observation_space: likewise for measurements.
        dynamics_jacobian: `(x, u) -> (n, n)`, used in place of automatic derivatives by first-order methods.
        observation_jacobian: `(x, u) -> (m, n)`, likewise.
        state_names, state_units, observation_names, observation_units: for tables, files and plots.

    Raises:
        ValueError: a shape that does not fit; a covariance that is not symmetric or not positive semi-definite.

    Example:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(
        ...     dynamics=lambda x, u: jnp.stack([x[0] + 0.1 * x[1], x[1] - 0.1 * jnp.sin(x[0])]),
        ...     observation=lambda x, u: jnp.sin(x[:1]),
        ...     process_noise=1e-4 * jnp.eye(2), observation_noise=1e-2 * jnp.eye(1),
        ...     initial=sp.Gaussian(jnp.zeros(2), jnp.eye(2)))
        >>> sp.filter(model, jnp.zeros((50, 1))).mean.shape
        (50, 2)
    """

    dynamics: Callable
    observation: Callable
    process_noise: Additive | NonAdditive
    observation_noise: Additive | NonAdditive
    initial: Gaussian
    state_space: Space = eqx.field(static=True)
    observation_space: Space = eqx.field(static=True)
    state_names: tuple[str, ...] = eqx.field(static=True)
    state_units: tuple[str, ...] = eqx.field(static=True)
    observation_names: tuple[str, ...] | None = eqx.field(static=True)
    observation_units: tuple[str, ...] | None = eqx.field(static=True)

    def __init__(
        self,
        dynamics: Callable,
        observation: Callable,
        process_noise: Any,
        observation_noise: Any,
        initial: Gaussian,
        *,
        state_space: Space | None = None,
        observation_space: Space | None = None,
        dynamics_jacobian: Callable | None = None,
        observation_jacobian: Callable | None = None,
        state_names: tuple[str, ...] | None = None,
        state_units: tuple[str, ...] | None = None,
        observation_names: tuple[str, ...] | None = None,
        observation_units: tuple[str, ...] | None = None,
    ):
        checks.callables(dynamics=dynamics, observation=observation)
        if not isinstance(initial, Gaussian):
            raise ValueError(f"initial must be sp.Gaussian(mean, cov), got {type(initial).__name__}")
        self.process_noise = _noise("process_noise", process_noise)
        self.observation_noise = _noise("observation_noise", observation_noise)
        self.initial = initial
        self.dynamics = with_jacobian(dynamics, dynamics_jacobian) if dynamics_jacobian else dynamics
        self.observation = with_jacobian(observation, observation_jacobian) if observation_jacobian else observation
        self.state_space = state_space or Euclidean()
        self.observation_space = observation_space or Euclidean()
        checks.initial(initial, self.state_space)
        self.process_noise.fits("process_noise", initial.cov.shape[-1], "state")
        n = initial.mean.shape[-1]
        self.state_names = checks.names("state_names", state_names, n) or tuple(f"x{i}" for i in range(n))
        self.state_units = checks.names("state_units", state_units, n, distinct=False) or ("",) * n
        self.observation_names = checks.names("observation_names", observation_names)
        self.observation_units = checks.names("observation_units", observation_units, distinct=False)


def with_jacobian(function: Callable, jacobian: Callable) -> Callable:
    """`function(x, ...)` whose derivative in `x` is `jacobian(x, ...)`, as given; other derivatives are kept."""

    def differentiated(x: Array, *rest: Any) -> Array:
        point = jax.lax.stop_gradient(x)
        return function(point, *rest) + jacobian(point, *rest[:1]) @ (x - point)

    return differentiated


def _noise(name: str, noise: Any) -> Additive | NonAdditive:
    if isinstance(noise, Additive | NonAdditive):
        return noise
    if isinstance(noise, Gaussian):
        return Additive(noise)
    cov = checks.array(name, noise)
    checks.covariance(name, cov, series=True)
    return Additive(cov)


def _noise_arrays(cov: Any, mean: Any) -> tuple[Array, Array]:
    if isinstance(cov, Gaussian):
        cov, mean = cov.cov, cov.mean
    cov = checks.array("cov", cov)
    checks.covariance("cov", cov, series=True)
    mean = jnp.zeros(cov.shape[-1:], cov.dtype) if mean is None else checks.array("mean", mean)
    if mean.shape[-1:] != cov.shape[-1:] or mean.ndim > 2:
        raise ValueError(f"mean of a noise must be ({cov.shape[-1]},) as its covariance, got shape {mean.shape}")
    return cov, mean
