"""Gaussian-sum filters as recipes."""

from dataclasses import dataclass
from typing import Any, ClassVar

from jaxtyping import Array

from sigmapoint import checks
from sigmapoint.methods import gaussian_filter, srukf
from sigmapoint.model import StateSpaceModel
from sigmapoint.noise import Additive
from sigmapoint.particles.gaussian_sum.filter import GaussianSumFilter, GaussianSumState, components_of
from sigmapoint.particles.gaussian_sum.recovery import ByComponent, ByExpectationMaximization, Recovery
from sigmapoint.particles.posterior import GaussianSumPosterior
from sigmapoint.particles.sampled import key_of_run
from sigmapoint.results import Posterior
from sigmapoint.spaces import same_elements
from sigmapoint.step import Method


@dataclass(frozen=True)
class GaussianSumMethod:
    """A Gaussian-sum filter; made by `gspf` and `gmsppf`.

    Args:
        components: of the mixture.
        particles: drawn at every instant.
        method: the Gaussian filter of each component.
        recovery: how particles are drawn and a mixture found in them.
    """

    components: int
    particles: int
    method: Method
    recovery: Recovery

    posterior: ClassVar[type[Posterior]] = GaussianSumPosterior
    state: ClassVar[type] = GaussianSumState
    smoothers: ClassVar[str] = ""

    def fits(self, model: StateSpaceModel) -> None:
        """Raise where the model has no density that this method needs."""
        for name, noise in (("observation_noise", model.observation_noise), ("initial", Additive(model.initial))):
            noise.require_density(name, "a Gaussian-sum filter", "use a sigma-point filter")
        if not same_elements(model.state_space):
            raise ValueError(
                "state_space must be that of vectors or angles for a Gaussian-sum filter, whose densities are compared "
                f"with each other, got {type(model.state_space).__name__}: use sp.upf(particles)"
            )
        self.method.fits(model)
        needed = self.components * len(components_of(model.observation_noise))
        if self.particles < needed:
            raise ValueError(
                f"particles must be at least {needed}, one for each component and component of observation_noise, got "
                f"{self.particles}"
            )

    def random(self, key: Any) -> Array:
        """The key of a run."""
        return key_of_run("a Gaussian-sum filter", key)

    def ready(self, model: StateSpaceModel, key: Array | None = None) -> GaussianSumFilter:
        """The model made ready."""
        return GaussianSumFilter.of(model, self, key)


def gspf(particles: int, components: int, *, method: Method | None = None) -> GaussianSumMethod:
    """The Gaussian-sum particle filter, with sigma-point proposals (Kotecha & Djurić 2003).

    Every component is a Gaussian of its own: its particles are drawn from its sigma-point filter's posterior, weighed
    by densities, and summed up by their mean and covariance.

    Args:
        particles: in all, at least as many as `components`, times those of an observation noise that is a mixture.
        components: of the mixture that stands for the belief. A process noise that is a mixture itself multiplies them;
            they are merged to as many again (Runnalls 2007).
        method: the Gaussian filter of each component; `srukf()` where not given.

    Returns:
        A method for `filter`, `online`, `batch` and `compare`, which then need a `key`.

    Raises:
        ValueError: fewer than one of either, or not a Gaussian filter.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x**2, jnp.eye(1), 0.1 * jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> post = sp.filter(model, jnp.full((1, 1), 4.0), method=sp.gspf(2000, 4), key=0)
        >>> bool(abs(post.mean[0, 0]) < 0.5), bool(post.std[0, 0] > 1.5)  # at −2 or at 2
        (True, True)
    """
    components = checks.whole("components", components, 1)
    particles = checks.whole("particles", particles, components)
    return GaussianSumMethod(components, particles, gaussian_filter("method", method, srukf()), ByComponent())


def gmsppf(particles: int, components: int, *, method: Method | None = None, iterations: int = 10) -> GaussianSumMethod:
    """The Gaussian-mixture sigma-point particle filter (van der Merwe & Wan 2003).

    Particles are drawn from the mixture of all sigma-point filters' posteriors, weighed by densities, and a mixture is
    found in them by expectation-maximisation.

    Args:
        particles: as for `gspf`.
        components: as for `gspf`.
        method: as for `gspf`.
        iterations: of expectation-maximisation, from the sigma-point filters' posteriors.

    Returns:
        As `gspf`.

    Raises:
        ValueError: as `gspf`.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> y = jnp.array([[1.0], [jnp.nan], [0.5]])
        >>> exact, post = sp.filter(model, y), sp.filter(model, y, method=sp.gmsppf(2000, 2), key=0)
        >>> bool(jnp.abs(post.mean - exact.mean).max() < 0.1)
        True
    """
    components = checks.whole("components", components, 1)
    particles = checks.whole("particles", particles, components)
    recovery = ByExpectationMaximization(checks.whole("iterations", iterations, 1))
    return GaussianSumMethod(components, particles, gaussian_filter("method", method, srukf()), recovery)
