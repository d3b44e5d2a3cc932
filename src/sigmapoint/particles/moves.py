"""Moves: copies of one particle are moved apart without a change of what they stand for.

One or more steps of a Markov chain that leaves p(x[k] | x[k−1], y[k]) of every particle's own origin as it is (Gilks &
Berzuini 2001; Wan & van der Merwe 2001, section 7.6): Metropolis & Hastings, x → x' with probability

    min(1, π(x') q(x | x') / π(x) q(x' | x)),      π(x) = p(y[k] | x) p(x | x[k−1]).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.linear_algebra.factors import cholesky
from sigmapoint.model import StateSpaceModel
from sigmapoint.particles.instant import Instant
from sigmapoint.particles.proposals.proposal import Drawn, Proposal, Prospect, require_densities
from sigmapoint.particles.state import ParticleState
from sigmapoint.particles.weights import moments

__all__ = ["independence", "metropolis", "random_walk"]
Kernel = Callable[[Array, Array], tuple[Array, Array]]


class Setting(NamedTuple):
    """What a move has to work with: the particles were drawn by `proposal` from their `prospect`."""

    at: Instant
    state: ParticleState
    proposal: Proposal
    prospect: Prospect


@runtime_checkable
class Move(Protocol):
    """A Markov chain for every particle. Hashable."""

    def fits(self, model: StateSpaceModel, /) -> None:
        """Raise where the model has no density that is needed."""
        ...

    def __call__(self, key: Array, setting: Setting, drawn: Drawn, /) -> Drawn:
        """The particles moved, with their ratios."""
        ...


@dataclass(frozen=True)
class Metropolis:
    """Steps of a kernel that is made for the cloud at hand."""

    kernel: Callable[[ParticleState], Kernel]
    steps: int

    def fits(self, model: StateSpaceModel) -> None:
        require_densities(model, "a move by a kernel", "use sp.moves.independence(), or no move")

    def __call__(self, key: Array, setting: Setting, drawn: Drawn) -> Drawn:
        at, N = setting.at, drawn.particles.shape[0]
        propose = jax.vmap(self.kernel(setting.state))

        def log_target(x: Array) -> Array:
            return at.log_likelihood(x) + at.log_prior(x, setting.state.origin.centre)

        def step(now: tuple[Array, Array], key: Array) -> tuple[tuple[Array, Array], None]:
            for_kernel, for_choice = jax.random.split(key)
            x, log_density = now
            there, log_q = propose(jax.random.split(for_kernel, N), x)
            log_there = log_target(there)
            moved = accepted(for_choice, log_there - log_density + log_q)
            return (jnp.where(moved[:, None], there, x), jnp.where(moved, log_there, log_density)), None

        start = (drawn.particles, log_target(drawn.particles))
        (particles, _), _ = jax.lax.scan(step, start, jax.random.split(key, self.steps))
        return drawn._replace(particles=particles)


@dataclass(frozen=True)
class Independence:
    """Steps to fresh draws of the proposal."""

    steps: int

    def fits(self, model: StateSpaceModel) -> None:
        model.process_noise.require_additive("process_noise", "a move to fresh draws", "use no move")

    def __call__(self, key: Array, setting: Setting, drawn: Drawn) -> Drawn:
        afresh = setting.proposal.afresh()

        def step(now: Drawn, key: Array) -> tuple[Drawn, None]:
            for_draw, for_choice = jax.random.split(key)
            there = afresh.draw(setting.at, for_draw, setting.state, setting.prospect)
            moved = accepted(for_choice, there.log_ratio - now.log_ratio)
            particles = jnp.where(moved[:, None], there.particles, now.particles)
            return Drawn(particles, jnp.where(moved, there.log_ratio, now.log_ratio), now.memory), None

        return jax.lax.scan(step, drawn, jax.random.split(key, self.steps))[0]


@dataclass(frozen=True)
class WithinCloud:
    """A normal step with a share of the cloud's own covariance."""

    scale: float

    def __call__(self, state: ParticleState) -> Kernel:
        cloud = moments(state.particles, state.log_weights, state.space)
        factor = self.scale * cholesky(cloud.cov)

        def step(key: Array, x: Array) -> tuple[Array, Array]:
            noise = jax.random.normal(key, factor.shape[:1], x.dtype)
            return state.space.retract(x, factor @ noise), jnp.zeros((), x.dtype)

        return step


@dataclass(frozen=True)
class Always:
    """The same kernel for any cloud."""

    kernel: Kernel

    def __call__(self, state: ParticleState) -> Kernel:
        return self.kernel


def accepted(key: Array, log_ratio: Float[Array, " N"]) -> Array:
    """With probability min(1, ratio); never to where it is NaN."""
    return jnp.log(jax.random.uniform(key, log_ratio.shape, log_ratio.dtype)) < log_ratio


def random_walk(scale: float = 0.5, steps: int = 1) -> Metropolis:
    """A move by normal steps, with a share of the cloud's own spread.

    Args:
        scale: of a step, relative to the standard deviations of the cloud [1].
        steps: how many.

    Raises:
        ValueError: a scale that is not positive, fewer steps than one.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.particle_filter(500, move=sp.moves.random_walk(0.3)).move.steps
        1
    """
    if not (scale := checks.number("scale", scale)) > 0:
        raise ValueError(f"scale must be positive, got {scale}")
    return Metropolis(WithinCloud(scale), checks.whole("steps", steps, 1))


def independence(steps: int = 1) -> Independence:
    """A move by fresh draws of the proposal (van der Merwe et al. 2000).

    Args:
        steps: how many.

    Raises:
        ValueError: fewer steps than one.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.particle_filter(500, move=sp.moves.independence()).move
        Independence(steps=1)
    """
    return Independence(checks.whole("steps", steps, 1))


def metropolis(kernel: Kernel, steps: int = 1) -> Metropolis:
    """A move by a kernel of your own.

    Args:
        kernel: `(key, x) -> (x_new, log q(x | x_new) − log q(x_new | x))` for one particle x (d,); the second is zero
            where the kernel is symmetric.
        steps: how many.

    Raises:
        ValueError: not a function, fewer steps than one.

    Examples:
        >>> import jax, jax.numpy as jnp, sigmapoint as sp
        >>> def jump(key, x):
        ...     return x + jax.random.laplace(key, x.shape), jnp.zeros(())
        >>> sp.particle_filter(500, move=sp.moves.metropolis(jump)).move.steps
        1
    """
    checks.function("kernel", kernel, "(key, x)")
    return Metropolis(Always(kernel), checks.whole("steps", steps, 1))
