"""Conditioning: what a value says about a state, both written over the same standard normal variables.

    y = ȳ + Φ ξ + E ε + v,      x = x̄ + X ξ,      ξ, ε ~ N(0, I),  v ~ N(0, R)

The value's elements `φ ζ`, rows of [Φ E S_R] over ζ = (ξ, ε, ν), are taken in one after the other in Carlson's form
(Carlson 1973; Bierman 1977, section V.2), which has sums of squares only and no downdate; large arrays by a Cholesky
factor in the libraries where that is as good (`_together`). With ρⱼ = φⱼ² + … + φₖ²:

    X⁺[:,j] = X[:,j] √(ρⱼ₊₁/ρⱼ) − (Σᵢ₌ⱼ₊₁ X[:,i] φᵢ) φⱼ / √(ρⱼ₊₁ ρⱼ),     gain = X φᵀ / ρ₁.

A lower triangular X stays so, and columns behind its last stay zero: of the noises, which come last, X needs only what
they add to ρ. The elements still to come are rows like those of the state and are carried along, so that correlated
noises need no care. Where the state shares the ε of the value (one set of points through two functions), ε joins ξ.

An update takes in a measurement: `difference` is the innovation, one column. A smoother takes in the next state: its
columns are a difference of means and a factor.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from sigmapoint.belief import Belief, Spread
from sigmapoint.compiled.native import LARGEST, materialized, small
from sigmapoint.linear_algebra.factors import one_where_zero, safe_sqrt
from sigmapoint.linear_algebra.leading import leading
from sigmapoint.rules.linearization import Linearization
from sigmapoint.rules.point_sets import ROUND_OFF

UNROLLED = 4
"""Up to so many elements are taken in without a loop: each then handles only what is left."""


class Joint(NamedTuple):
    """A function's value and the state it was taken at, over the same ξ, and the additive noise still to come."""

    value: Linearization
    state: Linearization
    noise: Spread | None


class Conditioned(NamedTuple):
    """The state given the value: `mean + step`, with covariance `root rootᵀ` (lower triangular where square)."""

    step: Float[Array, "n c"]
    root: Float[Array, "n k"]
    white: Float[Array, " d"]
    variance: Float[Array, " d"]
    informative: Bool[Array, " d"]


class Seen(NamedTuple):
    """What an element of the value looked like, given those before it."""

    white: Float[Array, ""]
    """the first column of its difference with unit variance; 0 where uninformative"""
    variance: Float[Array, ""]
    """the variance that was divided out; 1 where uninformative"""
    informative: Bool[Array, ""]
    """it says something: measured, with a variance, and not a combination of those before"""


class Rows(NamedTuple):
    """Quantities over ζ: one row of `slope` for each coordinate, and what is left of their differences."""

    slope: Float[Array, "k r"]
    difference: Float[Array, "r c"]


def condition(
    joint: Joint, difference: Float[Array, "d c"], active: Bool[Array, " d"], kind: type[Belief]
) -> Conditioned:
    """The state of `joint` given that its value differs from its mean by `difference`, in the elements `active`.

    Noises are added up in the way of beliefs of this `kind`.
    """
    floor = (ROUND_OFF * jnp.finfo(difference.dtype).eps * jax.lax.stop_gradient(joint.value.scale)) ** 2
    elements, states = _arranged(joint, difference, active, kind)
    size = max(elements.slope.shape)
    form = _together if size > 2 * LARGEST else _one_by_one if small(size // 2) else _one_by_one_once
    return form(elements, states, floor)


def _one_by_one(elements: Rows, states: Rows, floor: Float[Array, " d"]) -> Conditioned:
    n, d = states.slope.shape[0], floor.shape[0]

    def take(carry: tuple[Rows, Rows], i: Array | int) -> tuple[tuple[Rows, Rows], Seen]:
        phi, own = carry[0].slope[:, i], carry[0].difference[i]
        return _taken(materialized(jnp.append(_heard(phi[:n], floor[i]), phi[n:])), own, carry)

    if d > (UNROLLED if small(n) else 1):
        (_, states), seen = jax.lax.scan(take, (elements, states), jnp.arange(d))
        return Conditioned(-states.difference, states.slope.T, *seen)
    each = []
    for i in range(d):
        (elements, states), one = take((elements, states), i)
        each.append(one)
    return Conditioned(-states.difference, states.slope.T, *(jnp.stack(part) for part in zip(*each)))


_one_by_one_once = jax.jit(_one_by_one)
"""Traced once for a size, however often a program has it."""


@jax.custom_jvp
def _together(elements: Rows, states: Rows, floor: Float[Array, " d"]) -> Conditioned:
    """The same from the Cholesky factor of the covariance of (y, ξ), where that loses no more than a third of the
    digits; in libraries, for large arrays."""
    n, d = states.slope.shape[0], floor.shape[0]
    phi = jax.vmap(_heard)(elements.slope[:n].T, floor)
    P = phi @ phi.T + elements.slope[n:].T @ elements.slope[n:]
    silent = jnp.diagonal(P) <= 0
    P = P + jnp.diag(silent.astype(P.dtype))
    eye = jnp.eye(n, dtype=P.dtype)
    L = jnp.linalg.cholesky(jnp.block([[P, phi], [phi.T, eye]]), symmetrize_input=False)
    variance = jnp.diagonal(L) ** 2
    least = jnp.finfo(P.dtype).eps ** (1 / 3)
    clear = variance > least * jnp.append(jnp.diagonal(P), jnp.ones(n, P.dtype))
    clear &= variance > jnp.append(jnp.where(silent, 0.0, 1e4 * floor), jnp.zeros(n, P.dtype))

    def direct() -> Conditioned:
        difference = jnp.where(silent[:, None], 0.0, elements.difference)
        white = jax.scipy.linalg.solve_triangular(L[:d, :d], difference, lower=True)
        root = states.slope.T @ L[d:]
        return Conditioned(root[:, :d] @ white, root[:, d:], white[:, 0], variance[:d], ~silent)

    given = jax.lax.cond(clear.all(), direct, lambda: _one_by_one(elements, states, floor))
    return leading(given, elements, states, floor)


@_together.defjvp
def _together_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Conditioned, Conditioned]:
    return leading(jax.jvp(_one_by_one, primals, tangents), primals)


def _arranged(joint: Joint, difference: Array, active: Array, kind: type[Belief]) -> tuple[Rows, Rows]:
    """The value's elements over (ξ, noises), and the states over ξ."""
    y, x, noise = joint
    kept = active[:, None]
    slope, residual, shared = jnp.where(kept, y.slope, 0.0), jnp.where(kept, y.bend, 0.0), x.slope
    if x.residual.shape[1]:
        slope, shared = jnp.concatenate([slope, residual], 1), jnp.concatenate([shared, x.bend], 1)
        residual = residual[:, :0]
    noise = None if noise is None else noise.masked(active)
    if residual.shape[1]:  # few columns in place of many
        slope = jnp.concatenate([slope, kind.root(residual, noise)], 1)
    elif noise is not None:
        slope = jnp.concatenate([slope, noise.factor], 1)
    elements, states = materialized(slope.T, shared.T)
    nothing = jnp.zeros((shared.shape[0], difference.shape[1]), shared.dtype)
    return Rows(elements, jnp.where(kept, difference, 0.0)), Rows(states, nothing)


def _heard(part: Float[Array, " k"], floor: Float[Array, ""]) -> Float[Array, " k"]:
    """What was computed of an element, or nothing where it is mere round-off (its square below `floor`)."""
    return jnp.where(jnp.sum(part**2) <= floor, 0.0, part)


def _taken(
    phi: Float[Array, " k"], difference: Float[Array, " c"], carry: tuple[Rows, Rows]
) -> tuple[tuple[Rows, Rows], Seen]:
    """Elements and states after one element, and what it looked like. (Elements taken before are of no account.)"""
    rho = materialized(_from_each(phi**2))
    informative = ~(rho[0] <= 0)
    roots = safe_sqrt(rho)
    quotient = materialized(1.0 / one_where_zero(roots))
    kept = jnp.where(rho[:-1] <= 0, 1.0, roots[1:] * quotient[:-1])
    kept, moved = materialized(kept, phi * quotient[1:] * quotient[:-1])
    difference = jnp.where(informative, difference, 0.0)
    variance = jnp.where(informative, rho[0], 1.0)
    weighted = materialized(*(rows.slope * phi[: rows.slope.shape[0], None] for rows in carry))

    def given(rows: Rows, weighted: Array) -> Rows:
        k = weighted.shape[0]
        slope = rows.slope * kept[:k, None] - _behind(weighted) * moved[:k, None]
        return Rows(slope, rows.difference - jnp.outer(weighted.sum(0) / variance, difference))

    after = jax.tree.map(given, carry, weighted, is_leaf=lambda x: isinstance(x, Rows))
    after = jax.tree.unflatten(jax.tree.structure(after), materialized(*jax.tree.leaves(after)))
    return after, Seen(difference[0] * quotient[0], variance, informative)


def _from_each(x: Float[Array, " k"]) -> Float[Array, " k+1"]:
    """The sum of each element and all behind it; 0 at the end."""
    k = x.shape[0]
    if not small(k // 2):  # as many noises as states
        return jnp.append(jax.lax.cumsum(x, reverse=True), jnp.zeros_like(x[:1]))
    return jnp.sum(jnp.where(np.tri(k, k + 1, dtype=bool), x[:, None], 0.0), axis=0)


def _behind(A: Float[Array, "k r"]) -> Float[Array, "k r"]:
    """In every column, the sum of all elements behind each."""
    if not small(A.shape[0] // 2):
        return jax.lax.cumsum(jnp.pad(A[1:], ((0, 1), (0, 0))), 0, reverse=True)
    total = jnp.zeros(A.shape[1], A.dtype)
    rows = [total]
    for j in range(A.shape[0] - 1, 0, -1):
        total = total + A[j]
        rows.append(total)
    return jnp.stack(rows[::-1])
