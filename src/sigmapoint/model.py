"""The model: what the user writes once and runs through every filter.

    x[k+1] = f(x[k], u[k]) + w[k],      y[k] = h(x[k], u[k]) + v[k]

Row k of measurements, inputs and results belongs to the same instant; `initial` is the belief about x[0] before y[0].
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx

from sigmapoint import checks
from sigmapoint.checks import belief_checks
from sigmapoint.jacobians import with_jacobian
from sigmapoint.noise import Additive, Gaussian, NonAdditive, initial_of, noise_of
from sigmapoint.spaces import Euclidean, Space


class StateSpaceModel(eqx.Module):
    """A nonlinear state-space model, `x[k+1] = f(x[k], u[k]) + w[k]`, `y[k] = h(x[k], u[k]) + v[k]`.

    Args:
        dynamics: `f(x, u) -> x_next` with `x` (n,); `f(x, u, w)` where `process_noise` is `NonAdditive`. Any function
            that JAX can trace, an Equinox module, or `blackbox(...)`.
        observation: `h(x, u) -> y` with `y` (m,); `h(x, u, v)` where `observation_noise` is `NonAdditive`.
        process_noise: covariance (n, n), or (T, n, n) with row k for the step from k to k+1; `NonAdditive(cov)`; a
            `Gaussian` (additive, with a mean); or a distribution, any object with numpyro's `sample`, `log_prob`,
            `mean` and `variance`: Gaussian filters take its mean and covariance, particle filters all of it.
        observation_noise: likewise, (m, m) or (T, m, m).
        initial: belief about x[0], before y[0] is seen: a `Gaussian` or a distribution.
        state_space: where states live: `angles(...)` or a `Manifold`; ordinary vectors where not given.
        observation_space: likewise for measurements.
        dynamics_jacobian: `(x, u) -> (n, n)`, used in place of automatic derivatives by first-order methods.
        observation_jacobian: `(x, u) -> (m, n)`, likewise.
        state_names: one name for each state, for tables, files and plots.
        state_units: their units.
        observation_names: one name for each measured quantity.
        observation_units: their units.

    Raises:
        ValueError: a shape that does not fit; a covariance that is not symmetric or not positive semi-definite.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(
        ...     dynamics=lambda x, u: jnp.stack([x[0] + 0.1 * x[1], x[1] - 0.1 * jnp.sin(x[0])]),
        ...     observation=lambda x, u: jnp.sin(x[:1]),
        ...     process_noise=1e-4 * jnp.eye(2), observation_noise=1e-2 * jnp.eye(1),
        ...     initial=sp.Gaussian(jnp.zeros(2), jnp.eye(2)))
        >>> sp.filter(model, jnp.zeros((50, 1))).mean.shape
        (50, 2)
    """

    dynamics: Callable[..., Any]
    observation: Callable[..., Any]
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
        dynamics: Callable[..., Any],
        observation: Callable[..., Any],
        process_noise: Any,
        observation_noise: Any,
        initial: Any,
        *,
        state_space: Space | None = None,
        observation_space: Space | None = None,
        dynamics_jacobian: Callable[..., Any] | None = None,
        observation_jacobian: Callable[..., Any] | None = None,
        state_names: tuple[str, ...] | None = None,
        state_units: tuple[str, ...] | None = None,
        observation_names: tuple[str, ...] | None = None,
        observation_units: tuple[str, ...] | None = None,
    ):
        checks.callables(dynamics=dynamics, observation=observation)
        initial = initial_of(initial)
        self.process_noise = noise_of("process_noise", process_noise)
        self.observation_noise = noise_of("observation_noise", observation_noise)
        self.initial = initial
        self.dynamics = with_jacobian("dynamics_jacobian", dynamics, dynamics_jacobian)
        self.observation = with_jacobian("observation_jacobian", observation, observation_jacobian)
        self.state_space = Euclidean() if state_space is None else state_space
        self.observation_space = Euclidean() if observation_space is None else observation_space
        checks.space("state_space", self.state_space, initial.mean.shape[-1])
        checks.space("observation_space", self.observation_space, None)
        belief_checks.initial(initial, self.state_space)
        self.process_noise.fits("process_noise", initial.cov.shape[-1], "state")
        n = initial.mean.shape[-1]
        self.state_names = checks.names("state_names", state_names, n) or tuple(f"x{i}" for i in range(n))
        self.state_units = checks.names("state_units", state_units, n, distinct=False) or ("",) * n
        self.observation_names = checks.names("observation_names", observation_names)
        self.observation_units = checks.names("observation_units", observation_units, distinct=False)
