"""Dual estimation: two coupled filters, one for the states and one for the parameters.

The filter of the parameters is a `learner`, and what it learns is a function with a memory: a step of the filter of the
states (`cell`). Its measurement is what that one has not predicted (`costs`).

Source: Wan & Nelson, "Dual Extended Kalman Filter Methods" (2001), Table 5.3; Wan & van der Merwe, "The Unscented
Kalman Filter" (2001), section 7.5.
"""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from sigmapoint import checks, filtering
from sigmapoint.carry import Redraw
from sigmapoint.identification.cell import Cell
from sigmapoint.identification.costs import Cost, prediction_error
from sigmapoint.identification.coupled import Dual
from sigmapoint.identification.unknowns import Unknowns, built
from sigmapoint.learning.drift import Drift
from sigmapoint.learning.learner import fitting
from sigmapoint.learning.parameters import Parameters
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel


def dual(
    build: Callable[[Any], StateSpaceModel],
    theta: Any,
    drift: Drift | float | None = None,
    *,
    state_method: Method | None = None,
    parameter_method: Method | None = None,
    cost: Cost | None = None,
) -> Dual:
    """Two coupled filters, one for the states of a model and one for its unknown parameters.

    The parameters' filter sees how the other predicts measurements, and follows how that depends on them through all
    steps, by the derivative of mean and covariance; the gain's is part of it. O((n² + m) L²) a sample for n states, m
    measured elements and L parameters, and L to 2L + 1 steps of the state filter.

    Args:
        build: `build(theta) -> StateSpaceModel`, a function that JAX can trace.
        theta: the parameters and what is known of them, as for `joint`: `sp.Gaussian` over a vector (independent
            elements), or any pytree of `sp.real`, `sp.positive`, `sp.bounded` and numbers.
        drift: how much parameters may move between samples, any that `learner` takes; `fixed(0)` where not given, and
            a number q is `fixed(q)`. In
            squared units of the vector for `sp.Gaussian`; for a pytree, relative to the squared prior deviations.
        state_method: of the states' filter, any that draws its points anew; `srcdkf()` where not given.
        parameter_method: of the parameters' filter, as for `learner`; `srcdkf()` where not given.
        cost: what is to be small: `prediction_error()`, where not given, or `maximum_likelihood()`.

    Returns:
        A `Dual`: `init`, `update`, `filter`.

    Raises:
        ValueError: no unknown parameters, correlated ones, a `build` that gives no model, a method that is not for
            this, a drift or cost of another kind.

    Source: Wan & Nelson (2001), Table 5.3; Wan & van der Merwe (2001), section 7.5.

    Examples:
        >>> import jax, jax.numpy as jnp, sigmapoint as sp
        >>> def build(a):
        ...     return sp.StateSpaceModel(lambda x, u: a * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                               sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> x, y = sp.simulate(build(0.9), 500, key=jax.random.key(0))
        >>> result = sp.dual(build, sp.bounded(0.5, 0.3, low=-1.0, high=1.0)).filter(y)
        >>> bool(abs(result.theta - 0.9) < 3 * result.estimates.std[-1]), result.post.mean.shape
        (True, (500, 1))
    """
    checks.function("build", build, "theta")
    unknowns = Unknowns.of(theta)
    prior = unknowns.prior
    if checks.known(prior.cov) and np.count_nonzero(prior.cov - np.diag(np.diagonal(prior.cov))):
        raise ValueError("dual: theta must have a diagonal covariance, of independent parameters; sp.joint takes any")
    model = built(build, unknowns.tree(prior.mean))
    state_method = filtering.gaussian(model, state_method)
    if not isinstance(state_method.carry, Redraw):
        raise ValueError("dual: the state_method must not be augmented or extended: its points are not remembered")
    cost = prediction_error() if cost is None else cost
    checks.instance("cost", cost, Cost, "sp.prediction_error() or sp.maximum_likelihood()")
    point, directions = model.initial.mean.shape[0], model.initial.cov.shape[0]
    cell = Cell(build, unknowns, state_method, cost, model.state_space, point, directions)
    parameters = Parameters.of(prior.mean, jnp.sqrt(jnp.diagonal(prior.cov)))
    return Dual(cell, parameters, *fitting(parameters, parameter_method, drift, "parameter_method"))
