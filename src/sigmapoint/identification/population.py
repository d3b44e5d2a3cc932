"""A population of parameters, each with a filter of its own, that takes measurements in one row after the other.

    reweigh     W ← W p̂(y[k] | y[0], …, y[k−1], θ),      evidence ← evidence Σ W p̂
    rejuvenate  resample by W, and move every copy by Metropolis–Hastings with the likelihood of the rows so far

The second where the weights have become uneven: filters start anew for each move, which costs as much as all rows so
far. Steps have the shape of the population before (2.38² / L times its covariance).

Source: Chopin, Jacob & Papaspiliopoulos, "SMC²", J. R. Stat. Soc. B 75 (2013) 397, section 3.1.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sigmapoint.compiled.series import of_each
from sigmapoint.identification.likelihood import LogPosterior
from sigmapoint.identification.pseudo_marginal import Point, moved
from sigmapoint.linear_algebra.factors import cholesky
from sigmapoint.particles.resampling import systematic
from sigmapoint.particles.weights import effective, even, moments, weighed
from sigmapoint.spaces import Euclidean

HALF = 0.5
"""Share of the population below which its effective size leads to rejuvenation."""
SCALE = 2.38
"""Length of a step in deviations, times the root of the number of parameters (Gelman, Roberts & Gilks 1996)."""


class Population(NamedTuple):
    """Weighted parameters, and what has been learned on the way."""

    points: Point
    log_weights: Float[Array, " N"]
    log_evidence: Float[Array, ""]
    row: Int[Array, ""]
    """the next to be taken in"""

    @property
    def ess(self) -> Float[Array, ""]:
        """Effective size."""
        return effective(self.log_weights)


@eqx.filter_jit
def drawn(posterior: LogPosterior, z: Float[Array, "N L"], keys: Array) -> Population:
    """A population before any measurement. Parameters that make no model have no weight."""
    row = jnp.zeros((), int)
    points = of_each(lambda z, key: Point(z, *posterior.filtered(z, key, row)), z, keys)
    return Population(points, *weighed(even(z.shape[0], z.dtype), points.log_likelihood), row)


@eqx.filter_jit
def advanced(posterior: LogPosterior, population: Population) -> Population:
    """With as many rows as it takes until the weights are uneven, or none is left, or nothing explains a row."""
    T, N = posterior.y.shape[1], population.log_weights.shape[0]

    def going(p: Population) -> Array:
        return (p.row < T) & (p.ess >= HALF * N) & (p.log_evidence > -jnp.inf)

    def step(p: Population) -> Population:
        points, increments = of_each(lambda point: _with_row(posterior, point, p.row), p.points)
        log_weights, log_total = weighed(p.log_weights, increments)
        return Population(points, log_weights, p.log_evidence + log_total, p.row + 1)

    return jax.lax.while_loop(going, step, population)


def _with_row(posterior: LogPosterior, point: Point, row: Array) -> tuple[Point, Array]:
    """A point whose filters, one for each series, have seen one row more, and how dense that was."""
    model = posterior.build(posterior.theta(point.z))
    ends = posterior.ends(row + 1)

    def one(state: Any, y: Array, u: Any, end: Array) -> tuple[Any, Array]:
        def taken() -> tuple[Any, Array]:
            run = posterior.method.ready(model)
            after, info = run.update(state, y, u)
            return run.predict(after, u), info.log_likelihood

        return jax.lax.cond(row < end, taken, lambda: (state, jnp.zeros((), y.dtype)))

    y, u = jax.tree.map(lambda a: a[:, row], (posterior.y, posterior.u))
    ahead, each = of_each(one, point.ahead, y, u, ends)
    increment = each.sum().astype(point.z.dtype)
    return Point(point.z, point.log_likelihood + increment, ahead), increment


@eqx.filter_jit
def rejuvenated(
    posterior: LogPosterior, population: Population, key: Array, moves: Int[Array, ""]
) -> tuple[Population, Float[Array, ""]]:
    """The population resampled and moved, all of one weight, and the share of moves that were accepted."""
    points, log_weights, row = population.points, population.log_weights, population.row
    N, L = points.z.shape
    factor = SCALE / L**0.5 * cholesky(moments(points.z, log_weights, Euclidean()).cov)
    resample, move = jax.random.split(key)
    ancestors = systematic(resample, log_weights)

    def estimate(z: Array, key: Array) -> Point:
        return Point(z, *posterior.filtered(z, key, row))

    def one(point: Point, key: Array) -> tuple[Point, Array]:
        def step(i: Array, carry: tuple[Point, Array]) -> tuple[Point, Array]:
            walk, draw = jax.random.split(jax.random.fold_in(key, i))
            noise = factor @ jax.random.normal(walk, (L,), factor.dtype)
            point, info = moved(draw, posterior, carry[0], noise, estimate)
            return point, carry[1] + info.is_accepted.astype(factor.dtype)

        return jax.lax.fori_loop(0, moves, step, (point, jnp.zeros((), factor.dtype)))

    copies = jax.tree.map(lambda a: a[ancestors], points)
    points, accepted = of_each(one, copies, jax.random.split(move, N))
    after = Population(points, even(N, factor.dtype), population.log_evidence, row)
    return after, accepted.mean() / moves.astype(factor.dtype)
