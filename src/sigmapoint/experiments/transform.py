"""Mean and covariance of a nonlinearly transformed Gaussian: linearised, by sigma points, and in truth.

Sources: Wan & van der Merwe, "The Unscented Kalman Filter" (2001), Figure 7.3 and Appendix A; Plett, ECE5550 chapter 6,
sections 6.3-6.4 (a prior of mean 1.05 in one dimension, a cloud in two). Polar coordinates: Julier & Uhlmann (1997).

What the papers show in pictures is here also a number: the errors of mean and covariance at the prior drawn, and how
fast they vanish as the prior narrows. With standard deviation σ, the Taylor series about the mean (eqs 7.129-7.135)
says: a linearisation leaves an error of σ² in the mean; the unscented transform one of σ⁴, for any parameters. In the
covariance *either* leaves σ⁴: eq. 7.133 has no term of third degree, so a tangent is as good in order, not in size.

Higher orders need more of the Gaussian's moments: rules with h² = n + λ = 3 match the fourth along each axis, which in
one dimension (not in two) makes it σ⁶; p-point Gauss-Hermite rules reach σ²ᵖ; the simplex set lacks symmetry: σ³.
"""

from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint.experiments.results import Picture, Row, publish

from sigmapoint.rules.central import CentralDifference
from sigmapoint.rules.cubature import Cubature
from sigmapoint.rules.hermite import GaussHermite
from sigmapoint.rules.linearization import Rule
from sigmapoint.rules.simplex import Simplex
from sigmapoint.rules.taylor import Taylor
from sigmapoint.rules.unscented import Unscented
from sigmapoint.spaces import Euclidean

RULES: dict[str, Rule] = {
    "linearised": Taylor(),
    "UT": Unscented(1.0, 2.0, 0.0),
    "CDKF": CentralDifference(3**0.5),
    "cubature": Cubature(),
    "simplex": Simplex(1.0, 1.0, 0.0),
    "GH(3)": GaussHermite(3),
    "GH(5)": GaussHermite(5),
}
PUBLISHED: dict[tuple[str, str], float] = {("linearised", "mean"): 2, ("UT", "mean"): 4, ("UT", "covariance"): 4}
"""Leading order of the error that Appendix A states."""
WIDTHS = np.geomspace(1.0, 0.01, 21)
"""Factors on the prior's standard deviation."""
ROUNDING = 1e-13
"""Relative errors below this are rounding."""
DRAWS, QUICK_DRAWS = 1_000_000, 20_000


class Moments(NamedTuple):
    """Mean and covariance of y = g(x), and its covariance with x."""

    mean: Float[Array, " d"]
    cov: Float[Array, "d d"]
    cross: Float[Array, "n d"]


class Case(NamedTuple):
    """A function and the prior N(mean, factor factorᵀ) that goes through it."""

    g: Callable[[Array], Array]
    mean: Float[np.ndarray, " n"]
    factor: Float[np.ndarray, "n n"]


def _polar(x: Array) -> Array:
    return x[0] * jnp.stack([jnp.cos(x[1]), jnp.sin(x[1])])


def _mixed(x: Array) -> Array:
    return jnp.stack([x[0] ** 2 + x[1] * jnp.exp(x[0] / 2), jnp.sin(x[0] * x[1])])


CASES: dict[str, Case] = {
    "x²": Case(lambda x: x**2, np.array([1.05]), np.array([[0.6]])),
    "sin x": Case(jnp.sin, np.array([1.05]), np.array([[0.6]])),
    "exp x": Case(jnp.exp, np.array([1.05]), np.array([[0.6]])),
    "polar to Cartesian": Case(_polar, np.array([1.0, np.pi / 2]), np.diag([0.02, np.radians(15)])),
    "mixed, correlated": Case(_mixed, np.array([0.5, 0.8]), np.array([[0.4, 0.0], [-0.2, 0.35]])),
}
PICTURED = {"curve": "exp x", "ellipses": ("polar to Cartesian", "mixed, correlated")}
NARROWED = ("sin x", "exp x", "mixed, correlated")


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict]:
    """Run the experiment; see `Experiment.run`. `runs` is the number of Monte-Carlo draws."""
    draws = runs or (QUICK_DRAWS if quick else DRAWS)
    with jax.enable_x64(True):
        rows = [row for i, name in enumerate(CASES) for row in errors(name, draws, seed + i)]
        narrowed = {name: narrowing(CASES[name]) for name in NARROWED}
        pictures = _pictures(narrowed, seed)
    slopes = [row for name, found in narrowed.items() for row in order_rows(name, found)]
    rows.sort(key=lambda row: row.quantity)
    return publish(out, "Mean and covariance through a nonlinearity", claims(rows, slopes), rows + slopes, pictures)


def transform(
    rule: Rule, g: Callable[[Array], Array], mean: Float[Array, " n"], factor: Float[Array, "n n"]
) -> Moments:
    """Moments of g(x), x ~ N(mean, factor factorᵀ), as `rule` has them.

    Args:
        rule: e.g. `sp.ukf().rule`.
        g: a function of one vector.
        mean, factor: of the prior; the factor is lower triangular.

    Example:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> from sigmapoint.experiments.transform import transform
        >>> float(transform(sp.cdkf().rule, jnp.square, jnp.zeros(1), 2 * jnp.eye(1)).mean[0].round(4))
        4.0
    """
    lin = rule(lambda xi: g(mean + factor @ xi), jnp.zeros_like(mean), Euclidean())
    return Moments(lin.mean, lin.slope @ lin.slope.T + lin.residual @ lin.residual.T, factor @ lin.slope.T)


def truth(case: Case, order: int = 60) -> Moments:
    """Moments by Gauss-Hermite quadrature of high order, for reference."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(order)
    n = len(case.mean)
    xi = np.array(list(product(nodes, repeat=n)))
    w = np.array([np.prod(c) for c in product(weights / weights.sum(), repeat=n)])
    return _weighted(case, xi, w)


def monte_carlo(case: Case, draws: int, seed: int) -> Moments:
    """Moments of a sample."""
    xi = np.random.default_rng(seed).standard_normal((draws, len(case.mean)))
    return _weighted(case, xi, np.full(draws, 1 / draws))


def _weighted(case: Case, xi: np.ndarray, w: np.ndarray) -> Moments:
    x = case.mean + xi @ case.factor.T
    y = np.asarray(jax.vmap(case.g)(jnp.asarray(x)))
    centre = np.asarray(case.g(jnp.asarray(case.mean)))  # small differences from here keep their digits
    shift = w @ (y - centre)
    d = y - centre - shift
    return Moments(jnp.asarray(centre + shift), jnp.asarray((w * d.T) @ d), jnp.asarray((w * (x - case.mean).T) @ d))


def deviation(found: Moments, true: Moments) -> tuple[float, float]:
    """Errors: of the mean in true standard deviations (Mahalanobis), of the covariance relative (Frobenius)."""
    white = np.linalg.solve(np.linalg.cholesky(true.cov), np.asarray(found.mean - true.mean))
    return float(np.linalg.norm(white)), float(np.linalg.norm(found.cov - true.cov) / np.linalg.norm(true.cov))


def errors(name: str, draws: int, seed: int) -> list[Row]:
    """Errors of every rule at the prior drawn, and of a Monte-Carlo sample to judge them by."""
    case, true = CASES[name], truth(CASES[name])
    found = {m: transform(r, case.g, jnp.asarray(case.mean), jnp.asarray(case.factor)) for m, r in RULES.items()}
    sample = f"Monte Carlo, {draws:,} draws"
    rows = []
    for method, moments in {**found, sample: monte_carlo(case, draws, seed)}.items():
        runs = draws if method == sample else 1
        for what, error in zip(("mean, in standard deviations", "covariance, relative"), deviation(moments, true)):
            rows.append(Row("transform", f"error of the {what}: {name}", method, None, error, None, runs))
    return rows


class Narrowing(NamedTuple):
    """Errors of one rule as the prior narrows (one a width), and the order fitted to them."""

    widths: np.ndarray
    errors: np.ndarray
    order: float
    spread: float
    points: int


def narrowing(case: Case) -> dict[tuple[str, str], Narrowing]:
    """By rule and by moment: absolute errors against the width of the prior, and their order."""
    narrow = [case._replace(factor=width * case.factor) for width in WIDTHS]
    true = [truth(one) for one in narrow]
    found = {}
    for method, rule in RULES.items():
        rough = [transform(rule, c.g, jnp.asarray(c.mean), jnp.asarray(c.factor)) for c in narrow]
        mean = np.array([np.linalg.norm(a.mean - b.mean) / np.linalg.norm(b.mean) for a, b in zip(rough, true)])
        cov = np.array([np.linalg.norm(a.cov - b.cov) for a, b in zip(rough, true)])
        size = np.array([np.linalg.norm(b.cov) for b in true])
        found[method, "mean"] = fitted(mean, mean > ROUNDING)
        found[method, "covariance"] = fitted(cov, cov > 10 * ROUNDING * size)
    return found


def fitted(error: np.ndarray, clear: np.ndarray, most: int = 6) -> Narrowing:
    """The slope of log error over log width, from the narrowest priors (at most `most`) with errors above rounding."""
    first = np.flatnonzero(~np.append(clear, False))[0]
    last = slice(max(first - most, 0), first)
    if first < 3:
        return Narrowing(WIDTHS[:first], error[:first], np.nan, np.nan, first)
    (slope, _), cov = np.polyfit(np.log(WIDTHS[last]), np.log(error[last]), 1, cov="unscaled"), None
    return Narrowing(WIDTHS[:first], error[:first], float(slope), float(0.0 if cov is None else cov), first)


def order_rows(name: str, found: dict[tuple[str, str], Narrowing]) -> list[Row]:
    return []


def claims(rows: Sequence[Row], slopes: Sequence[Row]) -> Sequence[str]:
    return ()


def _pictures(narrowed: dict, seed: int) -> list[Picture]:
    return []
