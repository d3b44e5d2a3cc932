"""Joint estimation: parameters as states that stay, or move a little.

    [x[k+1]; z[k+1]] = [f(x[k], u[k]; z[k]) + w[k]; z[k] + r[k]],        y[k] = h(x[k], u[k]; z[k]) + v[k]

Source: Wan & van der Merwe, "The Unscented Kalman Filter" (2001), equations 7.97 and 7.98.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.belief import Spread, symmetric
from sigmapoint.identification.unknowns import Unknowns, built
from sigmapoint.learning.drift import Annealed, Drift
from sigmapoint.model import StateSpaceModel
from sigmapoint.noise import Additive, Gaussian, NonAdditive
from sigmapoint.spaces import Space, beside

LONGEST = 1e7
"""Numbers in the covariances of a drift that changes with time."""


class Part(NamedTuple):
    """A function of the model as one of (x, z), and the covariance of its noise and mean."""

    call: Callable[..., Array]
    """with the model first: `(model, x, u)`, or `(model, x, u, w)`"""
    kind: type[Additive] | type[NonAdditive]
    mean: Array
    cov: Array
    lasting: bool


def joint(build: Callable[[Any], StateSpaceModel], theta: Any, drift: Any = 0.0) -> StateSpaceModel:
    """A model whose states are those of another and its unknown parameters.

    It is a plain model: every filter, smoother, driver and report works on it. The last states are the parameters, as
    the vector z of `estimates`, which has them in their own units.

    Args:
        build: `build(theta) -> StateSpaceModel`, a function that JAX can trace. Its noises may depend on the
            parameters; then they are part of the points. (How large a noise is cannot be learned so, as no Gaussian
            filter sees it in a mean: its parameter keeps its prior. Use `em`, `fit`, or `dual` with
            `maximum_likelihood()`.) Where the initial mean depends on them the belief about both is correlated, to
            first order; the initial covariance is that at their centre.
        theta: the parameters and what is known of them: `sp.Gaussian` over a vector, or any pytree of `sp.real`,
            `sp.positive`, `sp.bounded` and numbers; a number stands for one that may be off by its own size (0 by 1).
        drift: the variance that each gains at every step, so that it is followed as it changes: a number, variances
            (L,), a covariance (L, L), `sp.fixed(q)`, or `sp.annealed(q, rate, floor)` with a floor. In squared units of
            the vector for `sp.Gaussian`; for a pytree, relative to the squared prior deviations.

    Returns:
        The model, of n + L states: `z.` before the names of the parameters.

    Raises:
        ValueError: no unknown parameters, a drift of another kind, a `build` that gives no model.

    Source: Wan & van der Merwe (2001), equations 7.97 and 7.98.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> def build(theta):
        ...     return sp.StateSpaceModel(lambda x, u: theta * x, lambda x, u: x, 0.01 * jnp.eye(1),
        ...                               0.01 * jnp.eye(1), sp.Gaussian(jnp.ones(1), jnp.eye(1)))
        >>> model = sp.joint(build, sp.real(0.5, 0.3), drift=1e-6)
        >>> model.state_names, sp.filter(model, jnp.ones((20, 1))).mean.shape
        (('x0', 'z.theta'), (20, 2))
    """
    checks.function("build", build, "theta")
    unknowns = Unknowns.of(theta)
    L = unknowns.size

    def model(z: Float[Array, " L"]) -> StateSpaceModel:
        return built(build, unknowns.tree(z))

    at_prior = model(unknowns.prior.mean)
    dtype = at_prior.initial.mean.dtype  # the states', so that none is rounded to that of the parameters
    z0, P = unknowns.prior.mean.astype(dtype), unknowns.prior.cov.astype(dtype)
    d, n = at_prior.initial.mean.shape[0], at_prior.initial.cov.shape[0]
    motion = _part(model, z0, "process_noise", lambda m: m.dynamics, lambda m: m.state_space)
    sight = _part(model, z0, "observation_noise", lambda m: m.observation, lambda m: m.observation_space)
    q = motion.cov.shape[-1]

    def dynamics(xz: Array, u: Any, *w: Array) -> Array:
        x, z = xz[:d], xz[d:]
        moved = z + w[0][q:] if w else z
        return jnp.concatenate([jnp.asarray(motion.call(model(z), x, u, *(part[:q] for part in w)), dtype), moved])

    def observation(xz: Array, u: Any, *v: Array) -> Array:
        return sight.call(model(xz[d:]), xz[:d], u, *v)

    cov, mean = _beside(motion, _covariances(drift, L, dtype))
    return StateSpaceModel(
        dynamics,
        observation,
        motion.kind(cov, mean, lasting=motion.lasting),
        sight.kind(sight.cov, sight.mean, lasting=sight.lasting),
        _initial(model, z0, P),
        state_space=beside(at_prior.state_space, d, n),
        observation_space=at_prior.observation_space,
        state_names=(*at_prior.state_names, *(f"z.{name}" for name in unknowns.names)),
        state_units=(*at_prior.state_units, *("",) * L),
        observation_names=at_prior.observation_names,
        observation_units=at_prior.observation_units,
    )


def _part(
    model: Callable[[Array], StateSpaceModel],
    z0: Array,
    name: str,
    function: Callable[[StateSpaceModel], Callable[..., Any]],
    space: Callable[[StateSpaceModel], Space],
) -> Part:
    noise: Any = getattr(model(z0), name)
    if noise.distribution is not None:
        raise ValueError(f"joint: {name} is a distribution, and only its mean and covariance would be kept: give these")

    def numbers(z: Array) -> tuple[Array, Array]:
        noise = getattr(model(z), name)
        return noise.mean, noise.cov

    if not _depends(numbers, z0):
        # A drift that changes is at its floor at the end; a noise of the model's that does must cover the series.
        lasting = noise.lasting or (noise.cov.ndim == 2 and noise.mean.ndim == 1)
        return Part(lambda m, *args: function(m)(*args), type(noise), noise.mean, noise.cov, lasting)
    if noise.cov.ndim == 3 or noise.mean.ndim == 2:
        raise ValueError(f"joint: {name} depends on theta and on time; keep one of the two out of build")

    def through(m: StateSpaceModel, x: Array, u: Any, xi: Array) -> Array:
        here: Any = getattr(m, name)
        return here.kind(here.mean, Spread.of(here.cov)).through(function(m), space(m)).call(x, u, xi)

    q = noise.cov.shape[-1]
    return Part(through, NonAdditive, jnp.zeros(q, noise.cov.dtype), jnp.eye(q, dtype=noise.cov.dtype), True)


def _depends(function: Callable[[Array], Any], z: Array) -> bool:
    """Whether `z` enters: as the program is written, so that it can be asked while JAX traces."""
    program = jax.make_jaxpr(function)(z).jaxpr
    reached = {id(v) for v in program.invars}
    for line in program.eqns:
        if not reached.isdisjoint(map(id, line.invars)):
            reached.update(map(id, line.outvars))
    return not reached.isdisjoint(map(id, program.outvars))


def _covariances(drift: Any, L: int, dtype: Any) -> Float[Array, "*K L L"]:
    """Of the drift, for every step or one after the other."""
    if isinstance(drift, Drift):
        if not isinstance(drift, Annealed):
            raise ValueError(
                "joint: drift must be a variance, variances, a covariance, sp.fixed() or sp.annealed(), got "
                f"{type(drift).__name__}; other drifts are for sp.dual"
            )
        if drift.rate < 1 and not drift.floor:
            raise ValueError("joint: sp.annealed() needs a floor here, at which its variance stays")
        least = min(drift.floor, drift.q)
        steps = 1 if drift.rate == 1 else 1 + int(np.ceil(np.log(least / drift.q) / np.log(drift.rate)))
        if steps * L * L > LONGEST:
            raise ValueError(f"joint: this drift takes {steps} steps to reach its floor; with {L} parameters, too many")
        q = jnp.maximum(drift.q * drift.rate ** jnp.arange(steps, dtype=dtype), drift.floor)
        return jnp.multiply.outer(q if steps > 1 else q[0], jnp.eye(L, dtype=dtype))
    given = checks.array("drift", drift).astype(dtype)
    if given.shape not in ((), (L,), (L, L)):
        raise ValueError(f"drift must be a variance, variances ({L},) or a covariance ({L}, {L}), got {given.shape}")
    return given if given.ndim == 2 else jnp.diag(jnp.broadcast_to(given, (L,)))


def _beside(motion: Part, drift: Array) -> tuple[Array, Array]:
    """Covariance and mean of both, for every step where one of them changes."""
    L = drift.shape[-1]
    lengths = {a.shape[0] for a in (motion.cov, drift) if a.ndim == 3}
    if lengths:
        T = max(lengths)
        last = [jnp.minimum(jnp.arange(T), (a.shape[0] if a.ndim == 3 else 1) - 1) for a in (motion.cov, drift)]
        Q, D = (a[k] if a.ndim == 3 else jnp.broadcast_to(a, (T, *a.shape)) for a, k in zip((motion.cov, drift), last))
        cov = jax.vmap(jax.scipy.linalg.block_diag)(Q, D)
    else:
        cov = jax.scipy.linalg.block_diag(motion.cov, drift)
    mean = jnp.concatenate([motion.mean, jnp.zeros((*motion.mean.shape[:-1], L), motion.mean.dtype)], axis=-1)
    return cov, mean


def _initial(model: Callable[[Array], StateSpaceModel], z0: Float[Array, " L"], P: Float[Array, "L L"]) -> Gaussian:
    """States and parameters, correlated where the initial state depends on the parameters."""
    start = model(z0)

    def moved(z: Array) -> Array:
        return start.state_space.residual(model(z).initial.mean, start.initial.mean)

    J = jax.jacfwd(moved)(z0)
    across = J @ P
    cov = jnp.block([[start.initial.cov + symmetric(across @ J.T), across], [across.T, P]])
    return Gaussian(jnp.concatenate([start.initial.mean, z0]), symmetric(cov))
