"""Particle filters as recipes: a proposal, a selection, a resampling scheme, a move."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from jax.sharding import Mesh
from jaxtyping import Array

from sigmapoint import checks
from sigmapoint.devices import mesh
from sigmapoint.methods import ekf, srukf
from sigmapoint.model import StateSpaceModel
from sigmapoint.particles.moves import Move
from sigmapoint.particles.posterior import ParticlePosterior
from sigmapoint.particles.proposals.gaussian import carried
from sigmapoint.particles.proposals.proposal import Proposal
from sigmapoint.particles.proposals.transition import Prior
from sigmapoint.particles.resampling import Resampler, Resampling, systematic
from sigmapoint.particles.sampled import key_of_run
from sigmapoint.particles.selection import Afterwards, Ahead, Selection
from sigmapoint.particles.state import AXIS, ParticleState
from sigmapoint.particles.step import ParticleFilter
from sigmapoint.results import Posterior


@dataclass(frozen=True)
class ParticleMethod:
    """A particle filter; made by `particle_filter`.

    Args:
        particles: how many.
        proposal: what they are drawn from.
        resampler: how they are resampled, and when.
        move: what moves copies apart, or nothing.
        selection: when particles are chosen.
        over: devices that they are spread over, or nothing.
    """

    particles: int
    proposal: Proposal
    resampler: Resampler
    move: Move | None
    selection: Selection
    over: Mesh | None = None

    posterior: ClassVar[type[Posterior]] = ParticlePosterior
    state: ClassVar[type] = ParticleState
    smoothers: ClassVar[str] = "sp.backward_simulation() or sp.fixed_lag(lag)"

    def fits(self, model: StateSpaceModel) -> None:
        """Raise where the model has no density that this method needs."""
        model.observation_noise.require_density("observation_noise", "a particle filter", "use a sigma-point filter")
        self.proposal.fits(model)
        if self.move is not None:
            self.move.fits(model)

    def random(self, key: Any) -> Array:
        """The key of a run."""
        return key_of_run("a particle filter", key)

    def ready(self, model: StateSpaceModel, key: Array | None = None) -> ParticleFilter:
        """The model made ready."""
        return ParticleFilter.of(model, self, key)


def particle_filter(
    particles: int,
    *,
    proposal: Proposal | None = None,
    resampling: Resampling = systematic,
    threshold: float = 0.5,
    move: Move | None = None,
    devices: Sequence[Any] | None = None,
) -> ParticleMethod:
    """A particle filter of given parts (Wan & van der Merwe 2001, Algorithm 7.6.1).

    Args:
        particles: how many.
        proposal: what particles are drawn from: `proposals.prior()`, which is the default, `proposals.carried(method)`
            or `proposals.guided(method)`.
        resampling: `(key, log_weights)` to the place of each particle's ancestor: `resampling.systematic`,
            `.stratified`, `.residual`, `.multinomial`, or a function of your own.
        threshold: share of `particles` below which the effective sample size leads to resampling; 1 resamples at every
            step.
        move: moves copies apart after resampling: `moves.random_walk()`, `moves.independence()` or
            `moves.metropolis(kernel)`.
        devices: those that particles are spread over, for example `jax.devices()`; the numbers are the same, up to
            round-off of draws in 32 bits.

    Returns:
        A method for `filter`, `online`, `batch`, `compare`, `smooth` and `trajectories`, which then need a `key`.

    Raises:
        ValueError: fewer than one particle, a threshold outside of (0, 1], parts that are none, particles that cannot
            be spread evenly over the devices.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> method = sp.particle_filter(500, resampling=sp.resampling.stratified, threshold=0.8)
        >>> post = sp.filter(model, jnp.ones((5, 1)), method=method, key=0, keep=("mean", "particles"))
        >>> post.mean.shape, post.ess.shape, post.particles.shape
        ((5, 1), (5,), (5, 500, 1))
    """
    proposal = Prior() if proposal is None else proposal
    checks.instance("proposal", proposal, Proposal, "sp.proposals.prior(), .carried(method) or .guided(method)")
    checks.function("resampling", resampling, "(key, log_weights)")
    if move is not None:
        checks.instance("move", move, Move, "sp.moves.random_walk(), .independence() or .metropolis(kernel)")
    particles, threshold = checks.whole("particles", particles, 1), checks.fraction("threshold", threshold)
    over = mesh(devices, AXIS, particles)
    return ParticleMethod(particles, proposal, Resampler(resampling, threshold), move, Afterwards(), over)


def bootstrap(particles: int) -> ParticleMethod:
    """The bootstrap filter: particles drawn from the model, weighed by the likelihood (Gordon, Salmond & Smith 1993).

    Args:
        particles: how many.

    Raises:
        ValueError: fewer than one.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> y = jnp.array([[1.0], [jnp.nan], [0.5]])
        >>> exact, post = sp.filter(model, y), sp.filter(model, y, method=sp.bootstrap(10_000), key=0)
        >>> bool(jnp.abs(post.mean - exact.mean).max() < 0.05)
        True
    """
    return particle_filter(particles)


def ekpf(particles: int) -> ParticleMethod:
    """Particles proposed by an extended Kalman filter each (Wan & van der Merwe 2001, equation 7.111).

    Args:
        particles: how many.

    Raises:
        ValueError: fewer than one.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.ekpf(200).proposal.method == sp.ekf()
        True
    """
    return particle_filter(particles, proposal=carried(ekf()))


def upf(particles: int) -> ParticleMethod:
    """The unscented particle filter: particles proposed by an unscented Kalman filter each (equations 7.112 to 7.119).

    Each filter's covariance is carried along. Where that is far wider than the process noise, as of a tracker with
    little noise, nearly all draws are in vain (`ess` near 1): use `particle_filter` with `proposals.guided(srukf())`.

    Args:
        particles: how many.

    Raises:
        ValueError: fewer than one.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x**2 / 4, jnp.eye(1), 0.01 * jnp.eye(1),
        ...                            sp.Gaussian(jnp.ones(1), jnp.eye(1)))
        >>> y = jnp.ones((10, 1))
        >>> sharp, blind = (sp.filter(model, y, method=m(200), key=0).ess.mean() for m in (sp.upf, sp.bootstrap))
        >>> bool(sharp > blind)
        True
    """
    return particle_filter(particles, proposal=carried(srukf()))


def auxiliary(method: ParticleMethod) -> ParticleMethod:
    """The same filter, choosing particles by how well they can reach the next measurement (Pitt & Shephard 1999).

    Args:
        method: any particle filter.

    Returns:
        The method, with the predictive density of the measurement as first-stage weight, as the Gaussian filter of the
        proposal finds it, or `srukf()` for the prior. With `proposals.guided` on a model linear in its measurements
        that is exact, and all particles weigh the same: fully adapted.

    Raises:
        ValueError: not a particle filter.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), 0.01 * jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> adapted = sp.auxiliary(sp.particle_filter(100, proposal=sp.proposals.guided(sp.ekf()), threshold=1.0))
        >>> sp.filter(model, jnp.ones((3, 1)), method=adapted, key=0).ess.round().tolist()
        [100.0, 100.0, 100.0]
    """
    checks.instance("method", method, ParticleMethod, "a particle filter such as sp.bootstrap(1000)")
    return replace(method, proposal=method.proposal.afresh(), selection=Ahead())
