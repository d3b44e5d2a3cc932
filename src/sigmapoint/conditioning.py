"""Conditioning: what a value says about a state, both written over the same standard normal variables.

    y = ȳ + Φ ξ + E ε + v,      x = x̄ + X ξ,      ξ, ε ~ N(0, I),  v ~ N(0, R)

The value's elements `φ ζ`, rows of [Φ E S_R] over ζ = (ξ, ε, ν), are taken in one after the other in Carlson's form
(Carlson 1973; Bierman 1977, section V.2), which has sums of squares only and no downdate. With ρⱼ = φⱼ² + … + φₖ²:

    X⁺[:,j] = X[:,j] √(ρⱼ₊₁/ρⱼ) − (Σᵢ₌ⱼ₊₁ X[:,i] φᵢ) φⱼ / √(ρⱼ₊₁ ρⱼ),     gain = X φᵀ / ρ₁.

A lower triangular X stays so, and columns behind its last stay zero: of the noises, which come last, X needs only what
they add to ρ. The elements still to come are rows like those of the state and are carried along, so that correlated
noises need no care. Where the state shares the ε of the value (one set of points through two functions), ε joins ξ.

An update takes in a measurement: `difference` is the innovation, one column. A smoother takes in the next state: its
columns are a difference of means and a factor.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from sigmapoint.belief import Spread
from sigmapoint.linalg import one_where_zero, safe_sqrt, tria
from sigmapoint.native import materialized, small
from sigmapoint.rules.linearization import Linearization

UNROLLED = 4
"""Up to so many elements are taken in without a loop: each then handles only what is left."""
ROUND_OFF = 4.0
"""A slope this many times the round-off of the numbers that it was computed from says nothing."""


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
    """Quantities over ζ: their columns, and what is left of their differences."""

    columns: Float[Array, "r k"]
    difference: Float[Array, "r c"]


def condition(joint: Joint, difference: Float[Array, "d c"], active: Bool[Array, " d"]) -> Conditioned:
    """The state of `joint` given that its value differs from its mean by `difference`, in the elements `active`."""
    floor = (ROUND_OFF * jnp.finfo(difference.dtype).eps * jax.lax.stop_gradient(joint.value.scale)) ** 2
    elements, states = _arranged(joint, difference, active, floor)
    d, n = difference.shape[0], states.columns.shape[1]

    def take(carry: tuple[Rows, Rows], i: Array | int) -> tuple[tuple[Rows, Rows], Seen]:
        phi, own = carry[0].columns[i], carry[0].difference[i]
        heard = jnp.append(_heard(phi[:n], floor[i]), phi[n:])
        return _taken(Rows(materialized(heard), own), carry)

    if d > (UNROLLED if small(n) else 1):
        (_, states), seen = jax.lax.scan(take, (elements, states), jnp.arange(d))
        return Conditioned(-states.difference, states.columns, *seen)
    each = []
    for i in range(d):
        (elements, states), one = take((elements, states), i)
        each.append(one)
    return Conditioned(-states.difference, states.columns, *(jnp.stack(part) for part in zip(*each)))


def _arranged(joint: Joint, difference: Array, active: Array, floor: Array) -> tuple[Rows, Rows]:
    """The value's elements over (ξ, noises), and the states over ξ."""
    y, x, noise = joint
    kept = active[:, None]
    slope, residual, shared = jnp.where(kept, y.slope, 0.0), jnp.where(kept, y.residual, 0.0), x.slope
    if x.residual.shape[1]:
        slope, shared = jnp.concatenate([slope, residual], 1), jnp.concatenate([shared, x.residual], 1)
        residual = residual[:, :0]
    noise = None if noise is None else noise.masked(active)
    noises = [jnp.zeros_like(slope[:, :0])] if noise is None else [noise.factor]
    if residual.shape[1]:  # few columns in place of many
        noises = [tria(jnp.concatenate([jax.vmap(_heard)(residual, floor), *noises], 1))]
    elements = Rows(jnp.concatenate([slope, *noises], 1), jnp.where(kept, difference, 0.0))
    return elements, Rows(shared, jnp.zeros((shared.shape[0], difference.shape[1]), shared.dtype))


def _heard(part: Float[Array, " k"], floor: Float[Array, ""]) -> Float[Array, " k"]:
    """What was computed of an element, or nothing where it is mere round-off (its square below `floor`)."""
    return jnp.where(jnp.sum(part**2) <= floor, 0.0, part)


def _taken(element: Rows, carry: tuple[Rows, Rows]) -> tuple[tuple[Rows, Rows], Seen]:
    """Elements and states after one element, and what it looked like. (Elements taken before are of no account.)"""
    phi, difference = element
    rho = materialized(_behind(jnp.pad(phi**2, (1, 1))[None])[0, :-1])
    informative = ~(rho[0] <= 0)
    roots = safe_sqrt(rho)
    quotient = materialized(1.0 / one_where_zero(roots))
    kept = materialized(jnp.where(rho[:-1] <= 0, 1.0, roots[1:] * quotient[:-1]))
    moved = materialized(phi * quotient[1:] * quotient[:-1])
    difference = jnp.where(informative, difference, 0.0)
    variance = jnp.where(informative, rho[0], 1.0)

    def given(rows: Rows) -> Rows:
        k = rows.columns.shape[1]
        weighted = materialized(rows.columns * phi[None, :k])
        columns = rows.columns * kept[None, :k] - _behind(weighted) * moved[None, :k]
        moving = rows.difference - jnp.outer(weighted.sum(1) / variance, difference)
        return Rows(materialized(columns), materialized(moving))

    elements, states = carry
    return (given(elements), given(states)), Seen(difference[0] * quotient[0], variance, informative)


def _behind(A: Float[Array, "r k"]) -> Float[Array, "r k"]:
    """In every row, the sum of all elements behind each."""
    if not small(A.shape[1]):
        return jax.lax.cumsum(jnp.pad(A[:, 1:], ((0, 0), (0, 1))), 1, reverse=True)
    total = jnp.zeros(A.shape[0], A.dtype)
    columns = [total]
    for j in range(A.shape[1] - 1, 0, -1):
        total = total + A[:, j]
        columns.append(total)
    return jnp.stack(columns[::-1], axis=1)
