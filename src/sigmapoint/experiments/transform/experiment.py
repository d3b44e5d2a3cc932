"""Mean and covariance of a nonlinearly transformed Gaussian: linearised, by sigma points, and in truth.

Sources: Wan & van der Merwe, "The Unscented Kalman Filter" (2001), Figure 7.3 and Appendix A; Plett, ECE5550 chapter 6,
sections 6.3-6.4 (a prior of mean 1.05 in one dimension, a cloud in two).

What the papers show in pictures is here also a number: the errors of mean and covariance at the prior drawn, and how
fast they vanish as the prior narrows. With standard deviation σ, the Taylor series about the mean (eqs 7.129-7.135)
says: a linearisation leaves an error of σ² in the mean; the unscented transform one of σ⁴, for any parameters. In the
covariance *either* leaves σ⁴: eq. 7.133 has no term of third degree, so a tangent is as good in order, not in size.

Higher orders need more of the Gaussian's moments: rules with h² = n + λ = 3 match the fourth along each axis, which in
one dimension (not in two) makes it σ⁶; p-point Gauss-Hermite rules reach σ²ᵖ; the simplex set lacks symmetry: σ³.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint.experiments.publishing.results import Claim, Picture, Row, publish
from sigmapoint.experiments.transform.cases import CASES, Case, Moments, deviation, monte_carlo, truth
from sigmapoint.experiments.transform.figures import Clouds, Gaussian2, Line, curve, ellipses, orders
from sigmapoint.rules.central import CentralDifference
from sigmapoint.rules.cubature import Cubature
from sigmapoint.rules.hermite import GaussHermite
from sigmapoint.rules.linearization import Rule, SigmaPointRule
from sigmapoint.rules.simplex import Simplex
from sigmapoint.rules.taylor import Taylor
from sigmapoint.rules.unscented import Unscented
from sigmapoint.spaces import Euclidean

SIGMA_POINT_RULES: dict[str, SigmaPointRule] = {
    "UT": Unscented(1.0, 2.0, 0.0),
    "CDKF": CentralDifference(3**0.5),
    "cubature": Cubature(),
    "simplex": Simplex(1.0, 1.0, 0.0),
    "GH(3)": GaussHermite(3),
    "GH(5)": GaussHermite(5),
}
RULES: dict[str, Rule] = {"linearised": Taylor(), **SIGMA_POINT_RULES}
PUBLISHED: dict[tuple[str, str], float] = {("linearised", "mean"): 2, ("UT", "mean"): 4, ("UT", "covariance"): 4}
"""Leading order of the error that Appendix A states."""
WIDTHS = np.geomspace(1.0, 0.01, 21)
"""Factors on the prior's standard deviation."""
ROUNDING = 1e-13
"""Relative errors below this are rounding."""
ORDERS_WITHIN = 0.1
DRAWS, QUICK_DRAWS = 1_000_000, 20_000


CURVE, PLANES = "exp x", ("polar to Cartesian", "mixed, correlated")
NARROWED = ("sin x", "exp x", "mixed, correlated")


def run(runs: int | None, seed: int, out: Path, quick: bool) -> list[dict[str, Any]]:
    """Run the experiment; see `Experiment.run`. `runs` is the number of Monte-Carlo draws."""
    draws = runs or (QUICK_DRAWS if quick else DRAWS)
    with jax.enable_x64(True):
        rows = [row for i, name in enumerate(CASES) for row in errors(name, draws, seed + i)]
        narrowed = {name: narrowing(CASES[name]) for name in NARROWED}
        pictures = _pictures(narrowed, seed)
    slopes = [row for name, found in narrowed.items() for row in order_rows(name, found)]
    rows.sort(key=lambda row: row.quantity)
    return publish(
        out,
        "Mean and covariance through a nonlinearity",
        claim(rows, slopes),
        claims(rows, slopes),
        rows + slopes,
        pictures,
    )


def transform(
    rule: Rule, g: Callable[[Array], Array], mean: Float[Array, " n"], factor: Float[Array, "n n"]
) -> Moments:
    """Moments of g(x), x ~ N(mean, factor factorᵀ), as `rule` has them.

    Args:
        rule: e.g. `sp.ukf().rule`.
        g: a function of one vector.
        mean, factor: of the prior; the factor is lower triangular.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> from sigmapoint.experiments.transform.experiment import transform
        >>> float(transform(sp.cdkf().rule, jnp.square, jnp.zeros(1), 2 * jnp.eye(1)).mean[0].round(4))
        4.0
    """
    lin = rule(lambda step: g(mean + step), factor, Euclidean())
    return Moments(lin.mean, lin.slope @ lin.slope.T + lin.residual @ lin.residual.T, factor @ lin.slope.T)


def by_rules(case: Case, factors: Float[Array, "F n n"]) -> dict[str, Moments]:
    """Moments by every rule, for several factors of the prior's covariance at once."""
    mean = jnp.asarray(case.mean)

    @jax.jit
    @jax.vmap
    def each(factor: Array) -> list[Moments]:  # not a dictionary: JAX would sort it
        return [transform(rule, case.g, mean, factor) for rule in RULES.values()]

    return dict(zip(RULES, each(factors)))


def errors(name: str, draws: int, seed: int) -> list[Row]:
    """Errors of every rule at the prior drawn, and of a Monte-Carlo sample to judge them by."""
    case, true = CASES[name], truth(CASES[name])
    found = {m: Moments(*(a[0] for a in f)) for m, f in by_rules(case, jnp.asarray(case.factor[None])).items()}
    sample = f"Monte Carlo, {draws:,} draws"
    rows = []
    for method, moments in {**found, sample: monte_carlo(case, draws, seed)}.items():
        runs, note = (draws, f"1/√N = {draws**-0.5:.2g}") if method == sample else (1, "")
        for what, error in zip(("mean, in standard deviations", "covariance, relative"), deviation(moments, true)):
            rows.append(Row("transform", f"error of the {what}: {name}", method, None, error, None, runs, note))
    return rows


def narrowing(case: Case) -> dict[tuple[str, str], Line]:
    """By rule and by moment: absolute errors against the width of the prior, and their order."""
    factors = jnp.asarray(WIDTHS[:, None, None] * case.factor)
    true = [truth(case._replace(factor=np.asarray(factor))) for factor in factors]
    means, covs = np.array([one.mean for one in true]), np.array([one.cov for one in true])
    found = {}
    for method, rough in by_rules(case, factors).items():
        mean = np.linalg.norm(rough.mean - means, axis=1) / np.linalg.norm(means, axis=1)
        cov, size = np.linalg.norm(rough.cov - covs, axis=(1, 2)), np.linalg.norm(covs, axis=(1, 2))
        found[method, "mean"] = fitted(mean, mean > ROUNDING)
        found[method, "covariance"] = fitted(cov, cov > 10 * ROUNDING * size)
    return found


def fitted(error: np.ndarray, clear: np.ndarray, most: int = 6) -> Line:
    """The slope of log error over log width, from the narrowest priors (at most `most`) with errors above rounding."""
    kept = int(np.argmin(np.append(clear, False)))
    widths, error = WIDTHS[:kept], error[:kept]
    if kept < most:
        return Line(widths, error, np.nan, np.nan)
    (slope, _), cov = np.polyfit(np.log(widths[-most:]), np.log(error[-most:]), 1, cov=True)
    return Line(widths, error, float(slope), float(np.sqrt(cov[0, 0])))


def order_rows(name: str, found: dict[tuple[str, str], Line]) -> list[Row]:
    """The fitted orders; exact rules have none."""
    rows = []
    for (method, moment), fit in sorted(found.items(), key=lambda item: item[0][1], reverse=True):
        note = f"{len(fit.errors)} widths above rounding" if fit.errors.size else "exact but for rounding"
        published = PUBLISHED.get((method, moment))
        quantity = f"order of the error of the {moment}: {name}"
        rows.append(Row("transform", quantity, method, published, fit.order, fit.spread, 1, note))
    return rows


def claim(rows: Sequence[Row], slopes: Sequence[Row]) -> Claim:
    """That of Appendix A, as far as it is about orders and the mean."""
    error = {(row.quantity, row.method): row.measured or 0.0 for row in rows}
    off = max(abs((row.measured or np.nan) - row.published) for row in slopes if row.published)
    mean = [(error[q, "linearised"], error[q, "UT"]) for q, m in error if m == "UT" and "mean" in q]
    return Claim(
        "a linearisation leaves an error of order σ² in the mean, the unscented transform one of σ⁴, and in the "
        "covariance, too",
        {
            f"fitted orders within {off:.2g} of these": off < ORDERS_WITHIN,
            "the UT's mean nearer in every case": all(ut < linearised for linearised, ut in mean),
        },
    )


def claims(rows: Sequence[Row], slopes: Sequence[Row]) -> Sequence[str]:
    """The papers' claims and what became of them, in words."""
    error = {(row.quantity, row.method): row.measured or 0.0 for row in rows}
    off = max(abs((row.measured or np.nan) - row.published) for row in slopes if row.published)
    mean = [(error[q, "linearised"], error[q, "UT"]) for q, m in error if m == "UT" and "mean" in q]
    worse = {
        method: ", ".join(q.split(": ")[1] for q, m in error if m == method and error[q, m] > error[q, "linearised"])
        for method in ("UT", "CDKF")
    }
    return (
        f"Orders of accuracy (Appendix A: linearised mean σ², UT mean σ⁴, UT covariance σ⁴): fitted exponents are "
        f"within {off:.2g} of these. The linearised covariance has order 4 too; eq. 7.133 has no odd terms.",
        f"Mean: linearised wrong by {min(a for a, _ in mean):.2f} to {max(a for a, _ in mean):.2f} true standard "
        f"deviations, the UT by at most {max(b for _, b in mean):.3f}.",
        'Covariance: Appendix A says that the UT\'s errors of higher order are "consistently smaller" than those of '
        f"linearisation. Functions here for which that fails: with α=1, β=2, κ=0, {worse['UT'] or 'none'}; "
        f"with the h² = 3 of the CDKF, {worse['CDKF'] or 'none'}.",
    )


def _pictures(narrowed: dict[str, dict[tuple[str, str], Line]], seed: int) -> list[Picture]:
    panels = {
        f"{name}: {moment}": {method: line for (method, what), line in found.items() if what == moment}
        for name, found in narrowed.items()
        for moment in ("mean", "covariance")
    }
    x = CASES[CURVE].mean + CASES[CURVE].factor[0] * np.linspace(-2.6, 2.6, 400)
    y = np.asarray(jax.vmap(CASES[CURVE].g)(jnp.asarray(x[:, None])))[:, 0]
    planes = {name: clouds(CASES[name], "UT", 3000, seed) for name in PLANES}
    captions = (
        "One dimension (notes 6.3-6.4): the density of y by linearisation, by three sigma points, and in truth.",
        "Two dimensions (Figure 7.3): mean and 95 % ellipse by linearisation, by the UT's five points, and in truth.",
        "Errors as the prior narrows, down to rounding; the legends give the fitted orders.",
    )
    return [
        Picture("transform-curve", captions[0], curve(CURVE, x, y, clouds(CASES[CURVE], "CDKF", 200_000, seed))),
        Picture("transform-ellipses", captions[1], ellipses(planes)),
        Picture("transform-orders", captions[2], orders(panels, 2)),
    ]


def clouds(case: Case, method: str, draws: int, seed: int) -> Clouds:
    """What the pictures show of a case, with the sigma points of one method."""
    n, true, found = len(case.mean), truth(case), by_rules(case, jnp.asarray(case.factor[None]))
    x = case.mean + np.random.default_rng(seed).standard_normal((draws, n)) @ case.factor.T
    points = case.mean + SIGMA_POINT_RULES[method].sigma_points(n).points @ case.factor.T
    y, images = (np.asarray(jax.vmap(case.g)(jnp.asarray(at))) for at in (x, points))
    gaussians = {"truth": Gaussian2(np.asarray(true.mean), np.asarray(true.cov))} | {
        m: Gaussian2(np.asarray(found[m].mean[0]), np.asarray(found[m].cov[0])) for m in ("linearised", method)
    }
    return Clouds(Gaussian2(case.mean, case.factor @ case.factor.T), x, y, gaussians, points, images)
