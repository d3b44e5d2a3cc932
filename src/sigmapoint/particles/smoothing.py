"""Looking back through particles.

Backward simulation (Godsill, Doucet & West 2004): from a particle of the last instant, drawn by its weight, back to one
of the instant before, drawn with weight W[k] p(x[k+1] | x[k]), and so on to the first. Every particle of an instant can
be reached from any of the next, so trajectories differ at all times; each takes O(N) an instant.

The genealogy costs nothing to look up, but soon all particles share their ancestors: good for a few instants (Kitagawa
1996, fixed lag).
"""

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sigmapoint import checks
from sigmapoint.compiled import series
from sigmapoint.filtering import fields, scan
from sigmapoint.model import StateSpaceModel
from sigmapoint.particles.method import ParticleMethod
from sigmapoint.particles.posterior import ParticlePosterior
from sigmapoint.particles.step import ParticleFilter
from sigmapoint.particles.weights import even, moments
from sigmapoint.smoothing.fixed_lag import lagged
from sigmapoint.smoothing.reversal import last_row
from sigmapoint.smoothing.smoother import Smoother, default_smoother
from sigmapoint.smoothing.trajectories import drawn
from sigmapoint.spaces import Space

AT_ONCE = 2**20
"""Pairs of a trajectory and a particle that are weighed together."""
BACK = 2**31 - 1
"""Of the run's key, what is for looking back."""


class Particles(NamedTuple):
    """Weighted particles of every instant, and their ancestors."""

    particles: Float[Array, "T N d"]
    log_weights: Float[Array, "T N"]
    ancestors: Int[Array, "T N"]

    def fields(self, keep: tuple[str, ...], space: Space) -> dict[str, Array]:
        """Those named in `keep`; moments among them."""
        cloud = jax.vmap(lambda x, log_w: moments(x, log_w, space))(self.particles, self.log_weights)
        return fields(keep, cloud, self)


def forward(
    run: ParticleFilter, y: Array, u: Any, keep: tuple[str, ...], real: Array | None
) -> tuple[Particles, dict[str, Array]]:
    """The particles of the filter, and what a smoother leaves as it is: innovations and likelihood."""

    def out(state: Any, info: Any) -> Any:
        here = Particles(state.particles, state.log_weights, state.ancestors)
        return here, fields((*keep, *ParticlePosterior.ALWAYS), info)

    (clouds, kept), log_likelihood, _ = scan(run, y, u, out, real)
    return clouds, {**kept, "log_likelihood": log_likelihood}


def backward(
    run: ParticleFilter, clouds: Particles, u: Any, key: Array, draws: int, real: Array | None = None
) -> Float[Array, "T draws d"]:
    """Trajectories, from the last instant to the first."""
    T, N = clouds.log_weights.shape
    last, space, dtype = last_row(T, real), run.model.state_space, clouds.log_weights.dtype

    def one(log_weights: Array, uniform: Array) -> Array:
        # (A maximum of minus infinity: round-off has taken the state from all that could have led to it.)
        log_weights = jnp.where(jnp.max(log_weights) > -jnp.inf, log_weights, 0.0)
        sums = jnp.cumsum(jnp.exp(log_weights - jnp.max(log_weights)))
        return jnp.searchsorted(sums, uniform * sums[-1], side="right")

    def step(later: Array, row: tuple[Array, Particles, Any]) -> tuple[Array, Array]:
        k, cloud, u = row
        fs, density = run.system.functions(k), run.system.process.density(k)
        centre = jax.vmap(lambda x: fs.f(x, u))(cloud.particles)
        every = jnp.ones(jax.eval_shape(space.residual, centre[0], centre[0]).shape[0], bool)

        def chosen(given: tuple[Array, Array]) -> Array:
            x, uniform = given
            off = jax.vmap(lambda c: space.residual(x, c))(centre)
            return one(cloud.log_weights + density.log_density(off, every), uniform)

        uniform = jax.random.uniform(jax.random.fold_in(key, k), (draws,), dtype)
        index = jax.lax.map(chosen, (later, uniform), batch_size=max(1, min(draws, AT_ONCE // N)))
        here = jnp.where(k < last, cloud.particles[jnp.minimum(index, N - 1)], later)
        return here, here

    uniform = jax.random.uniform(jax.random.fold_in(key, last), (draws,), dtype)
    index = jax.vmap(lambda w: one(clouds.log_weights[last], w))(uniform)
    end = clouds.particles[last][jnp.minimum(index, N - 1)]
    return series.scan(step, end, (jnp.arange(T), clouds, u), reverse=True)[1]


@dataclass(frozen=True)
class BackwardSimulation(Smoother):
    """Trajectories drawn back from the end."""

    draws: int

    kind: ClassVar[Any] = ParticleMethod

    def fits(self, model: StateSpaceModel) -> None:
        _require_density(model)

    def __call__(
        self, run: ParticleFilter, y: Array, u: Any, keep: tuple[str, ...], real: Array | None = None
    ) -> dict[str, Array]:
        clouds, kept = forward(run, y, u, keep, real)
        assert run.key is not None
        paths = backward(run, clouds, u, jax.random.fold_in(run.key, BACK), self.draws, real)
        T, dtype = y.shape[0], paths.dtype
        alike = jnp.broadcast_to(even(self.draws, dtype), (T, self.draws))
        own = jnp.broadcast_to(jnp.arange(self.draws, dtype=jnp.int32), (T, self.draws))
        return {**Particles(paths, alike, own).fields(keep, run.model.state_space), **kept}


def _require_density(model: StateSpaceModel) -> None:
    instead = "use sp.fixed_lag(lag), which looks up ancestors"
    model.process_noise.require_density("process_noise", "backward simulation", instead)


def backward_simulation(draws: int = 100) -> BackwardSimulation:
    """A smoother for particle filters: trajectories drawn back from the end (Godsill, Doucet & West 2004).

    The result's `mean`, `cov` and `std` are of these; `particles`, if kept, are the trajectories themselves.

    Args:
        draws: how many trajectories; each costs as much as a step of all particles, at every instant.

    Raises:
        ValueError: fewer than one.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> y = jnp.array([[1.0], [jnp.nan], [0.5]])
        >>> back = sp.smooth(model, y, method=sp.bootstrap(2000), smoother=sp.backward_simulation(2000), key=0)
        >>> bool(jnp.abs(back.mean - sp.smooth(model, y).mean).max() < 0.1)
        True
    """
    return BackwardSimulation(checks.whole("draws", draws, 1))


@default_smoother.register(ParticleMethod)
def _(method: ParticleMethod) -> BackwardSimulation:
    return backward_simulation()


@lagged.register(ParticleMethod)
def _(
    method: ParticleMethod, run: ParticleFilter, y: Array, u: Any, lag: int, keep: tuple[str, ...], real: Array | None
) -> dict[str, Array]:
    clouds, kept = forward(run, y, u, keep, real)
    T, N = clouds.log_weights.shape
    k, last = jnp.arange(T), last_row(T, real)

    def step(j: Array, index: Array) -> Array:
        at = k + lag - j
        earlier = jnp.take_along_axis(clouds.ancestors[jnp.minimum(at, T - 1)], index, axis=1)
        return jnp.where((at <= last)[:, None], earlier, index)

    own = jnp.broadcast_to(jnp.arange(N, dtype=clouds.ancestors.dtype), (T, N))
    index = jax.lax.fori_loop(0, lag, step, own)
    particles = jnp.take_along_axis(clouds.particles, index[:, :, None], axis=1)
    log_weights = clouds.log_weights[jnp.minimum(k + lag, last)]
    return {**Particles(particles, log_weights, index).fields(keep, run.model.state_space), **kept}


@drawn.register(ParticleMethod)
def _(
    method: ParticleMethod, model: StateSpaceModel, y: Array, u: Any, key: Array, draws: int
) -> Float[Array, "draws T d"]:
    _require_density(model)
    return _trajectories(method, model, y, u, key, draws)


@eqx.filter_jit
def _trajectories(
    method: ParticleMethod, model: StateSpaceModel, y: Array, u: Any, key: Array, draws: int
) -> Float[Array, "draws T d"]:
    run = method.ready(model, key)
    clouds = scan(run, y, u, lambda s, _: Particles(s.particles, s.log_weights, s.ancestors))[0]
    return jnp.moveaxis(backward(run, clouds, u, jax.random.fold_in(key, BACK), draws), 0, 1)
