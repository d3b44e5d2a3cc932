"""Expectation-maximisation: noises, the initial belief and parameters of a model from measurements alone.

Each step smooths with the model as it is (`expectation`), and takes the model under which what is then expected is the
most likely (`maximization`). For a linear model the likelihood of the measurements rises at every step (Dempster, Laird
& Rubin 1977); for another, as far as the method's Gaussians go.

Source: Shumway & Stoffer, "An approach to time series smoothing and forecasting using the EM algorithm" (1982).
"""

import warnings
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from sigmapoint import checks
from sigmapoint.blackbox import NoDerivative, unwrapped
from sigmapoint.contents import Card, Contents, Curve, Panel, Section
from sigmapoint.diagnosis.verdict import Verdict
from sigmapoint.filtering import gaussian
from sigmapoint.identification.contents import noises, values
from sigmapoint.identification.maximization import Constant, Found, Problem, maximized
from sigmapoint.identification.structures import Structure, check_structure, full
from sigmapoint.identification.unknowns import Unknowns, built
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel
from sigmapoint.noise import Additive
from sigmapoint.plotting import plot_panels
from sigmapoint.ragged import stacked


class EM(NamedTuple):
    """What `em` found."""

    model: StateSpaceModel
    """with the parameters, noises and initial belief of the highest likelihood"""
    theta: Any
    """the parameters, a pytree as given; nothing where none were"""
    log_likelihood: Float[np.ndarray, " K"]
    """before the first step and after each; natural logarithms, by the filter"""
    converged: bool
    """whether the last step changed it by less than the tolerance"""

    def __str__(self) -> str:
        first, best, steps = self.log_likelihood[0], np.nanmax(self.log_likelihood), len(self.log_likelihood) - 1
        ending = "" if self.converged else ", not converged"
        return f"log-likelihood from {first:.6g} to {best:.6g} in {steps} steps{ending}"

    def contents(self) -> Contents:
        """What a page about it shows: the log-likelihood step by step, parameters and noises."""
        text = "Each step smooths with the model as it is, and takes the one under which what is then expected is the "
        text += "most likely. The log-likelihood of the measurements rises, as far as the filter's approximation goes."
        best, steps = np.nanmax(self.log_likelihood), len(self.log_likelihood) - 1
        cards = (
            Card("Log-likelihood", best, f"at the start {self.log_likelihood[0]:.5g}"),
            Card("Steps", steps, "converged" if self.converged else "not converged"),
        )
        advice = "give more steps, or where the log-likelihood fell at the end, use sp.fit"
        bad = Verdict("warning", f"Not converged, and the best model so far is shown: {advice}.")
        verdicts = () if self.converged else (bad,)
        search = Section("Expectation-maximisation", text, cards, verdicts, panels=self._panels)
        learned = () if self.theta is None else (values(self.theta),)
        return Contents({}, (search, *learned, noises(self.model)))

    def plot(self) -> np.ndarray:
        """Draw the log-likelihood before the first step and after each; returns the matplotlib axes, an array of one.

        Raises:
            ImportError: matplotlib is not installed.
        """
        return plot_panels(self._panels)

    @property
    def _panels(self) -> dict[str, Panel]:
        steps = np.arange(len(self.log_likelihood))
        return {"Log-likelihood": Panel((Curve(self.log_likelihood, x=steps),), "step")}


def em(
    model: Any,
    y: Any,
    u: Any = None,
    method: Method | None = None,
    *,
    theta: Any = None,
    process_noise: Structure | None = full,
    observation_noise: Structure | None = full,
    initial: Structure | None = full,
    steps: int = 200,
    tolerance: float = 1e-6,
) -> EM:
    """Learn noises, the initial belief and parameters of a model from measurements, by expectation-maximisation.

    Args:
        model: the model to start with, with additive noises; or `build(theta) -> StateSpaceModel` with `theta`.
        y: measurements (T, m), NaN where an element was not measured; or a list of independent series (Tᵢ, m).
        u: inputs, as for `filter`; for a list, a list of them.
        method: as for `filter`; what smooths, and what takes the expectations.
        theta: unknown parameters, as for `fit`: a pytree of `sp.real`, `sp.positive`, `sp.bounded` and numbers, or
            `sp.Gaussian`. Their centre is where the search begins; it needs functions with derivatives.
        process_noise: what the covariance may be: `sp.full`, `sp.diagonal`, `sp.tied` (one variance for all), a
            function of your own from a second moment (n, n) to a covariance, or None to keep it as it is.
        observation_noise: likewise.
        initial: likewise, of the initial belief, whose mean is learned with it.
        steps: how many at most.
        tolerance: the log-likelihood changes by less, relative to the number of measurements: enough.

    Returns:
        An `EM`: the model, `theta`, the log-likelihood step by step, and whether it has converged.

    Raises:
        ValueError: as `filter`; nothing to learn; a structure that gives no covariance; noises to learn that change
            with time; noises to learn, or beside parameters, that are not additive; a likelihood that is not finite at
            the start; parameters of a black box; under `jax.jit`.
        ImportError: parameters, and optimistix is not installed (`pip install sigmapoint[fit]`).

    Warns where the likelihood has fallen (the approximation of the filter is too coarse to go on; the best model so far
    is returned), and where there were not enough steps.

    Source: Shumway & Stoffer (1982); Kokkala, Solin & Särkkä, "Sigma-point filtering and smoothing based parameter
    estimation in nonlinear dynamic systems" (2016).

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> def walk(q, r):
        ...     return sp.StateSpaceModel(lambda x, u: x, lambda x, u: x, q * jnp.eye(1), r * jnp.eye(1),
        ...                               sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> _, y = sp.simulate(walk(0.1, 1.0), 500, key=0)
        >>> found = sp.em(walk(1.0, 0.1), y, initial=None, tolerance=1e-4)
        >>> bool(0.05 < found.model.process_noise.cov[0, 0] < 0.2), bool((jnp.diff(found.log_likelihood) > 0).all())
        (True, True)
    """
    checks.untransformed("em", "sp.log_posterior", model, theta, y, u)
    steps, tolerance = checks.whole("steps", steps, 1), checks.number("tolerance", tolerance)
    problem, start = _problem(model, theta, method, process_noise, observation_noise, initial)
    y, u, lengths = stacked(problem.model(start), y, u)
    count = int(np.sum(~np.isnan(np.asarray(y))))
    if not count:
        raise ValueError("y has no measurements: every element is NaN")
    if theta is not None:
        checks.extra("optimistix", "em with theta", "fit")
    real = np.arange(y.shape[1]) < lengths[:, None]
    found, best, history = start, start, []
    for _ in range(steps + 1):
        after, value = _maximized(problem, found, y, u, real)
        history.append(float(value))
        if not np.isfinite(history[0]):
            raise ValueError("em: the log-likelihood of the model to start with is not finite: start from another")
        best = found if history[-1] >= max(history) else best
        if _ended(history, tolerance * count):
            break
        found = after
    fallen = _fallen(history, count)
    converged = not fallen and _ended(history, tolerance * count)
    _warn(fallen, converged, history, steps)
    return EM(problem.model(best), problem.theta(best), np.array(history), converged)


def _maximized(problem: Problem, found: Found, *data: Any) -> tuple[Found, Any]:
    try:
        return unwrapped(maximized, problem, found, *data)
    except NoDerivative as error:
        raise ValueError(
            "em: a blackbox has no derivative, which em needs for theta: use sp.joint for its parameters, or write the "
            "function in JAX; its noises are learned without theta"
        ) from error


def _ended(history: list[float], enough: float) -> bool:
    """Whether the last step has changed little, or was for the worse."""
    return not np.isfinite(history[-1]) or (len(history) > 1 and history[-1] - history[-2] < enough)


def _fallen(history: list[float], count: int) -> bool:
    """By more than round-off."""
    down = history[-2] - history[-1] if len(history) > 1 else 0.0
    return not np.isfinite(history[-1]) or down > 1e-9 * max(count, abs(history[-1]))


def _warn(fallen: bool, converged: bool, history: list[float], steps: int) -> None:
    if fallen:
        warnings.warn(
            f"em: the log-likelihood fell from {history[-2] if len(history) > 1 else history[0]:.6g} to "
            f"{history[-1]:.6g} at step {len(history) - 1}: the filter's approximation is too coarse to go on. The "
            "best model so far is returned; sp.fit maximises the likelihood of the same filter itself",
            stacklevel=3,
        )
    elif not converged:
        warnings.warn(f"em: not converged in {steps} steps; give more, or a larger tolerance", stacklevel=3)


def _problem(
    model: Any,
    theta: Any,
    method: Method | None,
    process: Structure | None,
    observation: Structure | None,
    initial: Structure | None,
) -> tuple[Problem, Found]:
    """What is sought, and where it starts."""
    if theta is None:
        if not isinstance(model, StateSpaceModel):
            expected = "a sp.StateSpaceModel, or a function of theta with theta=..."
            raise ValueError(f"model must be {expected}, got {type(model).__name__}")
        given, unknowns, z = model, None, None
    else:
        checks.function("model", model, "theta")
        unknowns = Unknowns.of(theta)
        z = unknowns.prior.mean
        given = built(model, unknowns.tree(z))
    for name, structure in (("process_noise", process), ("observation_noise", observation), ("initial", initial)):
        if structure is not None:
            check_structure(name, structure, getattr(given, name).cov)
    for name, structure in (("process_noise", process), ("observation_noise", observation)):
        noise: Any = getattr(given, name)
        if structure is not None and noise.distribution is not None:
            raise ValueError(f"em: the {name} of the model is a distribution; only a covariance can be learned")
        if (structure is not None or z is not None) and not isinstance(noise, Additive):
            raise ValueError(f"em: the {name} of the model is not additive; sp.fit learns such models")
        if structure is not None and noise.cov.ndim == 3:
            raise ValueError(f"em: the {name} of the model changes with time: keep it, {name}=None, or use sp.fit")
    if z is None and process is None and observation is None and initial is None:
        raise ValueError("em: nothing is left to learn; give theta, or a structure for one of the noises")
    found = Found(
        z,
        None if process is None else given.process_noise.cov,
        None if observation is None else given.observation_noise.cov,
        None if initial is None else given.initial,
    )
    source: Any = Constant(given) if theta is None else model
    return Problem(source, unknowns, gaussian(given, method), process, observation, initial), found
