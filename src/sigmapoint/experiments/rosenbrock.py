"""Rosenbrock's valley by Kalman filters: a residual whose target is zero, beside Levenberg-Marquardt and BFGS.

Wan & van der Merwe (2001), Figure 7.12: "the performance of the two filters [EKF, UKF] are comparable or superior to a
number of alternative optimization approaches (e.g., Davidon-Fletcher-Powell, Levenberg-Marquardt, etc.)", and
indistinguishable from each other; the UKF with option 2, the value at the mean, and α = 1e-4. The paper shows curves
and prints no numbers; of noise and drift nothing is said.

What is counted, up to the first value f ≤ 1e-12 that is seen: values of the residual (of f for BFGS), one for each
sigma point, and one more to see the last; and derivatives, a Jacobian or a gradient each.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import least_squares, minimize

import sigmapoint as sp
from sigmapoint.experiments.results import Picture, Row, mean_of, publish
from sigmapoint.experiments.rosenbrock_figures import valley
from sigmapoint.learning.drift import Drift
from sigmapoint.learning.learner import Learner, updated
from sigmapoint.methods import Method
from sigmapoint.problems import rosenbrock

TARGET = 1e-12
RUNS, QUICK_RUNS = 100, 5
UPDATES = 100
WIDTH = 2.0
"""random starts are uniform over ±2 in both directions"""
NOISE, DRIFT = 1e-6, sp.fixed(1e-2)
SMALL = {"alpha": 1e-4, "beta": 2.0, "kappa": 1.0}
UKF = "SR-UKF, option 2"
METHODS: dict[str, tuple[Method, str]] = {
    UKF: (sp.at_mean(sp.srukf(**SMALL)), "α=1e-4, β=2, κ=3−n: the paper's; 5 points an update"),
    "EKF": (sp.ekf(), "one value and one Jacobian an update"),
    "SR-CDKF, option 2": (sp.at_mean(sp.srcdkf()), "h = √3: how far the valley bends over the points counts as noise"),
    "SR-UKF": (sp.srukf(**SMALL), "α=1e-4, option 1, the mean output: biased as long as there is a drift"),
}
OTHERS: dict[str, tuple[float, Drift]] = {
    "noise 1e-4": (1e-4, DRIFT),
    "noise 1e-2": (1e-2, DRIFT),
    "drift fixed(1)": (NOISE, sp.fixed(1.0)),
    "drift fixed(1e-4)": (NOISE, sp.fixed(1e-4)),
    "forgetting(0.5)": (NOISE, sp.forgetting(0.5)),
    "robbins_monro(1, 0.5)": (NOISE, sp.robbins_monro(1.0, 0.5)),
}


class Search(NamedTuple):
    """Where one method came from one start."""

    path: Float[np.ndarray, "K 2"]
    """from iteration to iteration, the start first"""
    values: float
    """how many until the target was seen; NaN where it never was"""
    derivatives: float

    @property
    def costs(self) -> Float[np.ndarray, " K"]:
        """f along the path."""
        return _costs(self.path)

    @property
    def iterations(self) -> float:
        """How many until the target; NaN where there are not so many."""
        return _first(self.costs <= TARGET)


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`."""
    with jax.enable_x64(True):
        random = np.random.default_rng(seed).uniform(-WIDTH, WIDTH, (runs or (QUICK_RUNS if quick else RUNS), 2))
        starts = np.concatenate([[rosenbrock.START], random])
        found = {name: filtered(method, starts) for name, (method, _) in METHODS.items()}
        found |= {name: [search(start) for start in starts] for name, (search, _) in SEARCHES.items()}
        others = {name: filtered(METHODS[UKF][0], starts, *setting) for name, setting in OTHERS.items()}
    caption = (
        "Left and middle: from Rosenbrock's start. Right: values and derivatives (dots) until f ≤ 1e-12 from random "
        "starts, the classical one as a cross."
    )
    return publish(
        out,
        "Rosenbrock's valley: parameters of an error whose target is zero",
        findings(found),
        rows(found, others),
        [Picture("rosenbrock", caption, valley({name: found[name] for name in SHOWN}, found))],
    )


def filtered(method: Method, starts: np.ndarray, noise: float = NOISE, drift: Drift = DRIFT) -> list[Search]:
    """A filter from every start."""
    learner = sp.learner(lambda w, x: rosenbrock.residual(w), jnp.zeros(2), noise=noise, method=method, drift=drift)
    derivative = method.rule == sp.ekf().rule
    points = 1 if derivative else len(method.rule.constants(2).points)
    return [_counted(path, points, derivative) for path in np.asarray(_paths(learner, jnp.asarray(starts)))]


def _counted(path: np.ndarray, points: int, derivative: bool) -> Search:
    updates = _first(_costs(path) <= TARGET)
    return Search(path, points * updates + 1, updates if derivative else 0.0)


@eqx.filter_jit
def _paths(learner: Learner, starts: Float[Array, "R 2"]) -> Float[Array, "R K 2"]:
    def one(start: Array) -> Array:
        def step(state: Any, _: None) -> Any:
            state, _ = updated(learner, state, jnp.zeros(1), jnp.zeros((1, 2)))
            return state, state.mean

        _, path = jax.lax.scan(step, learner.init()._replace(mean=start), length=UPDATES)
        return jnp.concatenate([start[None], path])

    return jax.vmap(one)(starts)


class Log:
    """Every call of a function and its derivative, in order."""

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
        end = _first((_costs(np.array(self.points)) <= TARGET) & ~derivative)
        if np.isnan(end):
            return Search(np.array(path), np.nan, np.nan)
        before = derivative[: int(end)]
        return Search(np.array(path), float((~before).sum() + 1), float(before.sum()))


def levenberg_marquardt(start: np.ndarray, exact: bool = True) -> Search:
    """MINPACK's, through SciPy; with differences in place of the Jacobian where not `exact`."""
    log, tight = Log(), {"ftol": 1e-15, "xtol": 1e-15, "gtol": 1e-15}
    jacobian = log.noted(_jacobian, derivative=True) if exact else "2-point"
    end = least_squares(log.noted(_residual), start, jacobian, method="lm", **tight)
    accepted = [x for x, derivative in zip(log.points, log.derivative) if derivative]
    return log.search([*accepted, end.x] if exact else [start])


def bfgs(start: np.ndarray, exact: bool = True) -> Search:
    """SciPy's; with differences in place of the gradient where not `exact`."""
    log, path = Log(), [start]
    gradient = log.noted(_gradient, derivative=True) if exact else "2-point"
    minimize(log.noted(_cost), start, jac=gradient, method="BFGS", callback=path.append, options={"gtol": 1e-10})
    return log.search(path)


_residual, _cost = jax.jit(rosenbrock.residual), jax.jit(rosenbrock.cost)
_jacobian, _gradient = jax.jit(jax.jacfwd(rosenbrock.residual)), jax.jit(jax.grad(rosenbrock.cost))
SEARCHES: dict[str, tuple[Callable[[np.ndarray], Search], str]] = {
    "Levenberg-Marquardt": (levenberg_marquardt, "SciPy, exact Jacobian"),
    "BFGS": (bfgs, "SciPy, exact gradient of f"),
    "Levenberg-Marquardt, differences": (lambda x: levenberg_marquardt(x, False), "SciPy, Jacobian by differences"),
    "BFGS, differences": (lambda x: bfgs(x, False), "SciPy, gradient by differences"),
}
SHOWN = (UKF, "EKF", "SR-CDKF, option 2", "Levenberg-Marquardt", "BFGS")


def rows(found: dict[str, list[Search]], others: dict[str, list[Search]]) -> list[Row]:
    """The numbers."""
    notes = {name: note for name, (_, note) in {**METHODS, **SEARCHES}.items()}
    quantities: dict[str, Callable[[Search], float]] = {
        "iterations": lambda s: s.iterations,
        "values": lambda s: s.values,
        "derivatives": lambda s: s.derivatives,
    }
    classical = [
        Row("rosenbrock", f"{quantity} to f ≤ 1e-12 from (−1.2, 1)", name, None, of(searches[0]), None, 1, notes[name])
        for quantity, of in quantities.items()
        for name, searches in found.items()
        if not (quantity == "iterations" and len(searches[0].path) == 1)
    ]
    tenth = [
        Row("rosenbrock", "f after 10 updates from (−1.2, 1)", name, None, found[name][0].costs[10], None, 1)
        for name in METHODS
    ]
    random = [
        _over(f"{quantity} to f ≤ 1e-12 from random starts", name, [of(s) for s in searches[1:]])
        for quantity, of in quantities.items()
        for name, searches in found.items()
        if not (quantity == "iterations" and len(searches[0].path) == 1)
    ]
    varied = [
        _over(f"iterations to f ≤ 1e-12 from random starts, {UKF} with another noise or drift", name,
              [s.iterations for s in searches[1:]])
        for name, searches in others.items()
    ]  # fmt: skip
    return [*classical, *tenth, *random, *varied]


def _over(quantity: str, name: str, samples: list[float]) -> Row:
    samples_ = np.array(samples)
    mean, reached = mean_of(samples_), np.isfinite(samples_)
    largest = f", at most {samples_[reached].max():g}" if reached.any() else ""
    note = f"{reached.sum()} of {len(samples)} starts get there{largest}"
    return Row("rosenbrock", quantity, name, None, mean.value, mean.spread, mean.runs, note)


def findings(found: dict[str, list[Search]]) -> Sequence[str]:
    """What became of the paper's claims, in words."""
    return ()


def _costs(points: Float[np.ndarray, "K 2"]) -> Float[np.ndarray, " K"]:
    return (10 * (points[:, 1] - points[:, 0] ** 2)) ** 2 + (1 - points[:, 0]) ** 2


def _first(reached: np.ndarray) -> float:
    return float(np.argmax(reached)) if reached.any() else np.nan
