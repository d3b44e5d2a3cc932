"""Filter and smoother of an affine model as prefix sums over time, of depth O(log T).

Every instant is written as an element, and two neighbouring elements combine into one that stands for both; the
combination is associative, so that all prefixes come out of few steps of parallel work (`prefixes`). Square-root form:
every covariance and information matrix is a factor, combined by triangularisation, without a downdate.

Source: Yaghoobi, Corenflos, Hassan & Särkkä, "Parallel square-root statistical linear regression for inference in
nonlinear state space models" (2022), after Särkkä & García-Fernández (2021). An element of the filter is p(δ[j] | δ[i],
r[i+1:j]) = N(A δ[i] + b, U Uᵀ) with the likelihood of δ[i], information Z Zᵀ and information vector η; an element of
the smoother is p(δ[i] | δ[j], r[0:j]) = N(E δ[j] + g, D Dᵀ).
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint.affine import Affine
from sigmapoint.belief import SquareRoot
from sigmapoint.linear_algebra import factors as linalg
from sigmapoint.linear_algebra import triangularization

tria, solve_lower, solve_upper = (
    partial(f, many=True) for f in (triangularization.tria, linalg.solve_lower, linalg.solve_upper)
)
BLOCK = 8
"""Elements that are combined one after the other."""


class Step(NamedTuple):
    """An element of the filter; see the module."""

    A: Float[Array, "*T n n"]
    b: Float[Array, "*T n"]
    U: Float[Array, "*T n n"]
    eta: Float[Array, "*T n"]
    Z: Float[Array, "*T n n"]


class Back(NamedTuple):
    """An element of the smoother; see the module."""

    E: Float[Array, "*T n n"]
    g: Float[Array, "*T n"]
    D: Float[Array, "*T n n"]


def filtered(model: Affine) -> SquareRoot:
    """Beliefs about δ, each from the measurements up to its own instant, with a leading axis T."""
    sums = prefixes(after, jax.vmap(element)(model))
    return SquareRoot(sums.b, sums.U)


def smoothed(model: Affine, beliefs: SquareRoot) -> SquareRoot:
    """Beliefs about δ from all measurements, from the filtered ones."""
    ahead = jax.tree.map(lambda a: jnp.concatenate([a[1:], jnp.zeros_like(a[:1])]), model)
    elements = jax.vmap(_back)(beliefs, ahead)
    last = jnp.arange(beliefs.mean.shape[0]) == beliefs.mean.shape[0] - 1
    end = Back(jnp.zeros_like(elements.E), beliefs.mean, beliefs.factor)
    sums = prefixes(_before, _where(last, end, elements), reverse=True)
    return SquareRoot(sums.g, sums.D)


def prefixes(combine: Callable[[Any, Any], Any], elements: Any, *, reverse: bool = False) -> Any:
    """Every element combined with all before it (behind it, with `reverse`), along the leading axis T.

    In blocks: within each, one after the other; over the blocks by doubling (Hillis & Steele 1986); then each block
    with what is before it. That is 2 T + T/8 log₂(T/8) combinations in 8 + log₂(T/8) steps. (`associative_scan` of JAX
    takes 2 T in 2 log₂ T, and writes the combination out that many times for the compiler.)
    """
    if reverse:
        flipped = prefixes(combine, jax.tree.map(lambda a: a[::-1], elements))
        return jax.tree.map(lambda a: a[::-1], flipped)
    T = jax.tree.leaves(elements)[0].shape[0]
    blocks = -(-T // BLOCK)
    both = jax.vmap(combine)

    def arranged(a: Array) -> Array:
        a = jnp.pad(a, [(0, blocks * BLOCK - T), *[(0, 0)] * (a.ndim - 1)], mode="edge")
        return jnp.moveaxis(a.reshape(blocks, BLOCK, *a.shape[1:]), 1, 0)

    columns = jax.tree.map(arranged, elements)
    first, others = jax.tree.map(lambda a: a[0], columns), jax.tree.map(lambda a: a[1:], columns)

    def take(sums: Any, column: Any) -> tuple[Any, Any]:
        sums = both(sums, column)
        return sums, sums

    total, within = jax.lax.scan(take, first, others)
    within = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, within)
    index = jnp.arange(blocks)

    def double(i: Array, sums: Any) -> Any:
        distance = 2**i
        before = jax.tree.map(lambda a: a[jnp.maximum(index - distance, 0)], sums)
        return _where(index >= distance, both(before, sums), sums)

    total = jax.lax.fori_loop(0, (blocks - 1).bit_length(), double, total)
    before = jax.tree.map(lambda a: jnp.concatenate([a[:1], a[:-1]]), total)
    sums = jax.vmap(lambda column: _where(index > 0, both(before, column), column))(within)
    return jax.tree.map(lambda a: jnp.moveaxis(a, 0, 1).reshape(-1, *a.shape[2:])[:T], sums)


def _where(chosen: Array, a: Any, b: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(chosen.reshape(-1, *(1,) * (a.ndim - 1)), a, b), a, b)


def element(row: Affine) -> Step:
    """That of one instant."""
    m, n = row.H.shape
    kept = row.active[:, None]
    H, V = jnp.where(kept, row.H, 0.0), jnp.where(kept, row.V, 0.0)
    joint = tria(jnp.block([[H @ row.W, V], [row.W, jnp.zeros((n, m), V.dtype)]]))
    S, gain, U = joint[:m, :m], joint[m:, :m], joint[m:, m:]
    white = solve_lower(S, jnp.where(row.active, row.r, 0.0) - H @ row.c)
    M = solve_lower(S, H @ row.F)
    Z = jnp.pad(M.T, ((0, 0), (0, n - m))) if m <= n else tria(M.T)
    return Step(row.F - gain @ M, row.c + gain @ white, U, M.T @ white, Z)


def after(i: Step, j: Step) -> Step:
    """`i`, then `j`."""
    n = i.b.shape[0]
    eye = jnp.eye(n, dtype=i.b.dtype)
    joint = tria(jnp.block([[i.U.T @ j.Z, eye], [j.Z, jnp.zeros_like(eye)]]))
    S, gain, Z = joint[:n, :n], joint[n:, :n], joint[n:, n:]
    K = i.U @ solve_upper(S, gain.T)
    along = solve_lower(S, (j.A @ i.U).T).T
    B = j.A - j.A @ K
    information = j.eta - j.Z @ (j.Z.T @ i.b)
    return Step(
        B @ i.A,
        B @ (i.b + i.U @ (i.U.T @ j.eta)) + j.b,
        tria(jnp.concatenate([along, j.U], axis=1)),
        i.A.T @ (information - K.T @ information) + i.eta,
        tria(jnp.concatenate([i.A.T @ Z, i.Z], axis=1)),
    )


def _back(now: SquareRoot, after: Affine) -> Back:
    n = now.mean.shape[0]
    F, U = after.F, now.factor
    joint = tria(jnp.block([[F @ U, after.W], [U, jnp.zeros_like(U)]]))
    E = solve_upper(joint[:n, :n], joint[n:, :n].T).T
    return Back(E, now.mean - E @ (F @ now.mean + after.c), joint[n:, n:])


def _before(later: Back, earlier: Back) -> Back:
    E = earlier.E
    D = tria(jnp.concatenate([E @ later.D, earlier.D], axis=1))
    return Back(E @ later.E, E @ later.g + earlier.g, D)
