"""Rao-Blackwellised particle filters as recipes."""

from dataclasses import dataclass
from typing import Any, ClassVar

from jaxtyping import Array

from sigmapoint import checks
from sigmapoint.methods import gaussian_filter, srukf
from sigmapoint.model import StateSpaceModel
from sigmapoint.particles.posterior import ParticlePosterior
from sigmapoint.particles.rao_blackwell import RaoBlackwellisedFilter, RaoBlackwellisedState
from sigmapoint.particles.resampling import Resampler, Resampling, systematic
from sigmapoint.particles.sampled import key_of_run
from sigmapoint.results import Posterior
from sigmapoint.step import Filter, Method


@dataclass(frozen=True)
class RaoBlackwellisedMethod:
    """A Rao-Blackwellised particle filter; made by `rao_blackwellised`.

    Args:
        particles: how many.
        sampled: elements of the state that are drawn, by place or by name.
        method: the Gaussian filter of the others.
        resampler: how particles are resampled, and when.
    """

    particles: int
    sampled: tuple[int | str, ...]
    method: Method
    resampler: Resampler

    posterior: ClassVar[type[Posterior]] = ParticlePosterior
    state: ClassVar[type] = RaoBlackwellisedState
    smoothers: ClassVar[str] = ""

    def fits(self, model: StateSpaceModel) -> None:
        """Raise where the model has no such elements, or what no Gaussian filter takes as it is."""
        self.method.fits(model)
        by = "a Rao-Blackwellised filter, which draws from Gaussians"
        model.process_noise.require_additive(
            "process_noise", by, "use sp.bootstrap(particles), which draws through the dynamics"
        )
        for name in ("process_noise", "observation_noise", "initial"):
            if getattr(model, name).distribution is not None:
                raise ValueError(
                    f"{name} must be a Gaussian for a Rao-Blackwellised filter, whose particles are Gaussian filters, "
                    "got a distribution: give its covariance, or use sp.bootstrap(particles)"
                )
        self.places(model)

    def random(self, key: Any) -> Array:
        """The key of a run."""
        return key_of_run("a Rao-Blackwellised filter", key)

    def ready(self, model: StateSpaceModel, key: Array | None = None) -> RaoBlackwellisedFilter:
        """The model made ready."""
        return RaoBlackwellisedFilter(Filter.of(model, self.method), self, key)

    def places(self, model: StateSpaceModel) -> tuple[int, ...]:
        """Of the sampled elements, in the order of the state."""
        n, names = model.initial.cov.shape[-1], model.state_names

        def place(one: int | str) -> int:
            found = names.index(one) if one in names else one
            if isinstance(found, str) or not 0 <= found < n:
                listed = ", ".join(names)
                raise ValueError(f"sampled must be places from 0 to {n - 1} or names out of {listed}, got {found!r}")
            return found

        return tuple(sorted({place(one) for one in self.sampled}))


def rao_blackwellised(
    particles: int,
    sampled: tuple[int | str, ...],
    *,
    method: Method | None = None,
    resampling: Resampling = systematic,
    threshold: float = 0.5,
) -> RaoBlackwellisedMethod:
    """A particle filter that draws some elements of the state only; a Gaussian filter knows the others given these.

    Args:
        particles: how many.
        sampled: elements of the state that are drawn, by place or by name: those that make the model nonlinear, or
            whose belief is no Gaussian. They move by Gaussian noise: a mode that jumps from 0 to 1 is for `bootstrap`.
        method: the Gaussian filter of the others; `srukf()` where not given. Exact where the model is linear and
            Gaussian in them.
        resampling: as for `particle_filter`.
        threshold: as for `particle_filter`.

    Returns:
        A method for `filter`, `online`, `batch` and `compare`, which then need a `key`. Kept `particles` are the means
        of the particles' beliefs.

    Raises:
        ValueError: fewer than one particle, nothing to draw, not a Gaussian filter.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(  # a level that moves by a speed, seen through its square
        ...     lambda x, u: jnp.array([x[0] + x[1], x[1]]), lambda x, u: x[:1] ** 2, 0.1 * jnp.eye(2), jnp.eye(1),
        ...     sp.Gaussian(jnp.zeros(2), jnp.eye(2)), state_names=("level", "speed"))
        >>> method = sp.rao_blackwellised(500, ("level",))
        >>> post = sp.filter(model, jnp.full((5, 1), 4.0), method=method, key=0)
        >>> post.mean.shape, bool(post.std[-1, 0] > 1)
        ((5, 2), True)
    """
    particles, threshold = checks.whole("particles", particles, 1), checks.fraction("threshold", threshold)
    sampled = (sampled,) if isinstance(sampled, int | str) else tuple(sampled)
    if not sampled or not all(isinstance(s, int | str) and not isinstance(s, bool) for s in sampled):
        raise ValueError(f"sampled must be places or names of elements of the state, got {sampled!r}")
    method = gaussian_filter("method", method, srukf())
    checks.function("resampling", resampling, "(key, log_weights)")
    return RaoBlackwellisedMethod(particles, sampled, method, Resampler(resampling, threshold))
