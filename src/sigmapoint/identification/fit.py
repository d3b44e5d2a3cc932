"""Parameters from measurements: maximum likelihood, or maximum a posteriori, with standard errors.

    ẑ = argmax log p(y | θ(z)) + w log p(z),        Cov(ẑ) ≈ H⁻¹,    H = -∂²/∂z² of the same at ẑ,

w being 0 or 1. Derivatives go through the filter. Everything is done in units of the prior deviations.

Source: Harvey, "Forecasting, Structural Time Series Models and the Kalman Filter" (1989), sections 3.4 and 4.5.
"""

import warnings
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.blackbox import NoDerivative
from sigmapoint.contents import Card, Contents
from sigmapoint.diagnosis.verdict import Verdict
from sigmapoint.identification.contents import at_one_time
from sigmapoint.identification.estimates import Estimates
from sigmapoint.identification.likelihood import LogPosterior, log_posterior
from sigmapoint.identification.profile import Profile, plot_profiles
from sigmapoint.identification.unknowns import built
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel
from sigmapoint.printing import aligned

NEAR = 0.01
"""Standard deviations from the optimum at which a search has arrived."""
BETTER = 0.01
"""Log-likelihood above that of the fit that is no round-off."""


class Fit(eqx.Module):
    """What measurements say of the parameters of a model; made by `fit`. `print` of it is a table."""

    posterior: LogPosterior
    """the function that was made as large as possible"""
    z: Float[Array, " L"]
    """where that is"""
    z_cov: Float[Array, "L L"]
    """the inverse of the curvature there; NaN for elements that measurements leave open"""
    log_likelihood: float
    """natural logarithm of the density of all measurements, without a prior"""
    converged: bool
    """whether the optimum is closer than 0.01 standard deviations"""
    steps: int
    """how often the likelihood was computed on the way"""

    @property
    def theta(self) -> Any:
        """The parameters, as the pytree that `build` takes."""
        return self.posterior.theta(self.z)

    @property
    def model(self) -> StateSpaceModel:
        """The model with these parameters."""
        return built(self.posterior.build, self.theta)

    @property
    def estimates(self) -> Estimates:
        """Value, standard deviation and 95 % interval, each a pytree like the parameters, in their own units."""
        return Estimates.of(self.posterior.unknowns, self.z, jnp.sqrt(jnp.diagonal(self.z_cov)))

    @property
    def names(self) -> tuple[str, ...]:
        """Of the unknown parameters, in the order of `z`."""
        return self.posterior.unknowns.names

    def profile(self, name: str, points: int = 21) -> Profile:
        """The likelihood along one parameter, the others at their best.

        Args:
            name: which one, of `names`.
            points: how many, over three standard deviations to either side.

        Raises:
            ValueError: an unknown name, less than three points.
        """
        from sigmapoint.identification.optimum import profiled

        if name not in self.names:
            raise ValueError(f"profile: name must be one of {', '.join(self.names)}, got {name!r}")
        points = checks.whole("profile: points", points, 3)
        z, density = profiled(self.posterior, self.z, self.z_cov, jnp.asarray(self.names.index(name)), points)
        value = np.asarray(jax.vmap(self.posterior.unknowns.values)(z))[:, self.names.index(name)]
        profile = Profile(name, value, np.asarray(density), float(self.posterior(self.z)))
        if profile.log_likelihood.max() > profile.best + BETTER:
            warnings.warn(
                f"profile: at {name} = {value[profile.log_likelihood.argmax()]:.4g} the likelihood is higher than at "
                "the fit, which is a local maximum, or not quite one: fit again from there",
                stacklevel=2,
            )
        return profile

    def plot_profiles(self, points: int = 21) -> np.ndarray:
        """Draw the profile of every parameter; returns the matplotlib axes."""
        return plot_profiles([self.profile(name, points) for name in self.names])

    def contents(self) -> Contents:
        """What a page about it shows: the table of the parameters, and how the search ended."""
        cards = (
            Card("Log-likelihood", self.log_likelihood),
            Card("Evaluations", self.steps, "converged" if self.converged else "not converged"),
        )
        known = np.isfinite(np.diagonal(self.z_cov))
        left = ", ".join(name for name, there in zip(self.names, known) if not there)
        verdicts = [] if self.converged else [Verdict("bad", "Not converged: values and intervals are not to be used.")]
        if left:
            verdicts.append(Verdict("warning", f"The measurements leave {left} open, alone or together."))
        table = at_one_time(self.names, self.estimates)
        return Contents({}, (table._replace(cards=cards, verdicts=tuple(verdicts)),))

    def __str__(self) -> str:
        unknowns = self.posterior.unknowns
        std = jnp.sqrt(jnp.diagonal(self.z_cov))
        found = Estimates.of(unknowns.flat, self.z, std)
        rows = [("", "value", "std", "95 % interval")]
        for i, name in enumerate(self.names):
            value, spread, low, high = (f"{float(a[i]):.4g}" for a in (found.value, found.std, found.low, found.high))
            rows.append((name, value, spread, f"{low} … {high}") if spread != "nan" else (name, value, "open", ""))
        arrived = f"converged in {self.steps} steps" if self.converged else f"NOT CONVERGED after {self.steps} steps"
        return "\n".join([*aligned(rows), f"log-likelihood {self.log_likelihood:.6g}, {arrived}"])


def fit(
    build: Callable[[Any], StateSpaceModel],
    theta: Any,
    y: Any,
    u: Any = None,
    method: Method | None = None,
    *,
    prior: float = 0.0,
    steps: int = 200,
) -> Fit:
    """Fit the parameters of a model, noise levels among them, to measurements: maximum likelihood.

    Args:
        build: `build(theta) -> StateSpaceModel`, a function that JAX can trace and differentiate. Noises and the
            initial belief may depend on the parameters. Write it once: another function is compiled anew.
        theta: the parameters, as for `joint`: a pytree of `sp.real`, `sp.positive`, `sp.bounded` and numbers (one that
            may be off by its own size, 0 by 1), or `sp.Gaussian` over a vector. Their centre is where the search
            begins, their deviation its scale.
        y: measurements (T, m), NaN where an element was not measured; or a list of independent series (Tᵢ, m).
        u: inputs, as for `filter`; for a list, a list of them.
        method: as for `filter`. The likelihood is the one that this filter sees.
        prior: how often `theta` counts as knowledge, too: 0 for maximum likelihood, 1 for maximum a posteriori.
        steps: evaluations of the likelihood at most, before the last ones with Newton's method.

    Returns:
        A `Fit`: `theta`, `estimates`, `model`, `profile(name)`, `log_likelihood`, `converged`.

    Raises:
        ValueError: as `log_posterior`; nothing measured; a likelihood that is not finite at the start; a black box;
            under `jax.jit`.
        ImportError: optimistix is not installed (`pip install sigmapoint[fit]`).

    Warns where the search has not converged, and where measurements leave a parameter open (its deviation is NaN).

    Source: Harvey (1989), section 3.4.

    Examples:
        >>> import jax, jax.numpy as jnp, sigmapoint as sp
        >>> def build(theta):
        ...     return sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, theta["q"] * jnp.eye(1),
        ...                               theta["r"] * jnp.eye(1), sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> _, y = sp.simulate(build({"q": 0.5, "r": 0.2}), 300, key=jax.random.key(0))
        >>> found = sp.fit(build, {"q": sp.positive(1.0, 1.0), "r": sp.positive(1.0, 1.0)}, y, method=sp.ekf())
        >>> bool(found.estimates.low["q"] < 0.5 < found.estimates.high["q"]), found.converged
        (True, True)
    """
    from sigmapoint.identification.optimum import fitted

    checks.untransformed("fit", "sp.log_posterior", theta, y, u)
    weight, steps = checks.number("prior", prior), checks.whole("steps", steps, 1)
    if not 0 <= weight < np.inf:
        raise ValueError(f"prior must be 0 (maximum likelihood), 1 (maximum a posteriori) or above, got {prior}")
    posterior = log_posterior(build, theta, y, u, method)
    posterior = eqx.tree_at(lambda p: p.weight, posterior, weight * posterior.weight)
    if not posterior.measured:
        raise ValueError("y has no measurements: every element is NaN")
    try:
        z, cov, log_likelihood, distance, taken = fitted(posterior, steps)
    except NoDerivative as error:
        raise ValueError(
            "fit: a blackbox has no derivative, which fit needs: use sp.em for its noises or sp.joint for its "
            "parameters, or write the function in JAX"
        ) from error
    if not np.isfinite(log_likelihood):
        raise ValueError(
            "fit: the log-likelihood or its derivative is not finite at the start, the centre of theta: is "
            "build(theta) a model there, with noises above zero? Start elsewhere, or use a square-root method"
        )
    found = Fit(posterior, z, cov, float(log_likelihood), bool(distance < NEAR), int(taken))
    _warn(found, float(distance), steps)
    return found


def _warn(found: Fit, distance: float, steps: int) -> None:
    if not found.converged:
        out_of_steps = found.steps >= steps
        way = f"give steps more than {steps}, or" if out_of_steps else "the search went no further: give"
        warnings.warn(
            f"fit: not converged after {found.steps} steps, about {distance:.2g} standard deviations from the optimum: "
            f"{way} theta centres that are closer and deviations as large as they are off; a variance is sp.positive",
            stacklevel=3,
        )
        return
    left = [name for name, variance in zip(found.names, np.diagonal(found.z_cov)) if not np.isfinite(variance)]
    if left:
        warnings.warn(
            f"fit: the measurements leave {', '.join(left)} open, alone or together: the likelihood is flat there (as "
            "at a bound), and the standard deviation is NaN. Fix one, use prior=1, or see profile()",
            stacklevel=3,
        )
