"""Ways to the bottom of Rosenbrock's valley, with every call counted: Kalman filters, Levenberg-Marquardt, BFGS.

Counted are, up to the first value f ≤ 1e-12 that is seen, values of the residual (of f for BFGS) and derivatives: a
Jacobian, or a gradient. A filter takes one value for each sigma point of an update; one more shows that it is there.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import least_squares, minimize

import sigmapoint as sp
from sigmapoint.learning.drift import Drift
from sigmapoint.learning.learner import Learner
from sigmapoint.learning.update import updated
from sigmapoint.methods import Method
from sigmapoint.problems import rosenbrock
from sigmapoint.rules.linearization import SigmaPointRule

TARGET = 1e-12
UPDATES = 100


class Search(NamedTuple):
    """Where a method came from one start. Numbers are NaN where the target was not seen."""

    path: Float[np.ndarray, "K 2"]
    """from iteration to iteration, the start first"""
    costs: Float[np.ndarray, " K"]
    """f along the path"""
    values: float
    """how many until the target was seen"""
    derivatives: float
    """likewise"""
    least: float
    """of all values f"""

    @property
    def iterations(self) -> float:
        """How many until the target."""
        return _first(self.costs <= TARGET)


def filtered(method: Method, starts: Float[np.ndarray, "R 2"], noise: float, drift: Drift) -> list[Search]:
    """A filter from every start."""
    valley = sp.residual(lambda w, x, d: rosenbrock.residual(w))
    learner = sp.learner(valley, jnp.zeros(2), noise=noise, method=method, drift=drift)
    points = len(method.rule.constants(2).points) if isinstance(method.rule, SigmaPointRule) else 1
    jacobians = 0 if isinstance(method.rule, SigmaPointRule) else 1
    paths = _paths(learner, jnp.asarray(starts))
    return [_counted(*each, points, jacobians) for each in zip(np.asarray(paths), np.asarray(rosenbrock.cost(paths)))]


def _counted(path: np.ndarray, costs: np.ndarray, points: int, jacobians: int) -> Search:
    updates = _first(costs <= TARGET)
    return Search(path, costs, points * updates + 1, jacobians * updates, float(costs.min()))


@eqx.filter_jit
def _paths(learner: Learner, starts: Float[Array, "R 2"]) -> Float[Array, "R K 2"]:
    def one(start: Array) -> Array:
        def step(state: Any, _: None) -> Any:
            after = updated(learner.setup, state, (jnp.zeros(1), None), None)[0]
            return after, after.mean

        _, path = jax.lax.scan(step, learner.init()._replace(mean=start), length=UPDATES)
        return jnp.concatenate([start[None], path])

    return jax.vmap(one)(starts)


class Log:
    """Every call of a function and of its derivative, in order."""

    def __init__(self) -> None:
        self.points: list[np.ndarray] = []
        self.derivative: list[bool] = []

    def noted(self, function: Callable[[Any], Any], derivative: bool = False) -> Callable[[np.ndarray], Any]:
        """The function, noted here whenever it is called."""

        def call(x: np.ndarray) -> Any:
            self.points.append(np.array(x))
            self.derivative.append(derivative)
            return np.asarray(function(x))

        return call

    def search(self, path: Sequence[np.ndarray]) -> Search:
        """What came of it."""
        derivative = np.array(self.derivative)
        seen = np.where(derivative, np.inf, _costs(self.points))
        end = _first(seen <= TARGET)
        before = derivative[: int(end)] if np.isfinite(end) else derivative
        lost = np.where(np.isfinite(end), 0.0, np.nan)
        return Search(
            np.array(path), _costs(path), float((~before).sum() + 1 + lost), float(before.sum() + lost), seen.min()
        )


def levenberg_marquardt(start: np.ndarray, exact: bool = True) -> Search:
    """MINPACK's, through SciPy; with differences in place of the Jacobian where not `exact`."""
    log = Log()
    jacobian: Any = log.noted(_jacobian, derivative=True) if exact else "2-point"
    end = least_squares(log.noted(_residual), start, jacobian, method="lm", ftol=1e-15, xtol=1e-15, gtol=1e-15)
    accepted = [x for x, derivative in zip(log.points, log.derivative) if derivative]
    return log.search([*accepted, end.x] if exact else [start])


def bfgs(start: np.ndarray, exact: bool = True) -> Search:
    """SciPy's; with differences in place of the gradient where not `exact`."""
    log, path = Log(), [start]
    gradient = log.noted(_gradient, derivative=True) if exact else "2-point"
    minimize(log.noted(_cost), start, jac=gradient, method="BFGS", callback=path.append, options={"gtol": 1e-10})
    return log.search(path if exact else [start])


_residual, _cost = jax.jit(rosenbrock.residual), jax.jit(rosenbrock.cost)
_jacobian, _gradient = jax.jit(jax.jacfwd(rosenbrock.residual)), jax.jit(jax.grad(rosenbrock.cost))


def _costs(points: Sequence[np.ndarray]) -> Float[np.ndarray, " K"]:
    return np.array([float(_cost(x)) for x in points])


def _first(reached: np.ndarray) -> float:
    return float(np.argmax(reached)) if reached.any() else np.nan
