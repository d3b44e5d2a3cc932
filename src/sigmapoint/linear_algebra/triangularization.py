"""Triangularisation: from any factor of a covariance to a lower triangular one, by orthogonalising its rows.

Derivative of the triangularisation. With `A = L Q` (Q with orthonormal rows) and `B = dA Qᵀ`, the covariance moves by
`B Lᵀ + L Bᵀ`. Any antisymmetric `K` may be taken off, `dL = B − L K`, and `K` is chosen row by row so that `dL` is
lower triangular: the strictly upper part of `K` is that of `L⁻¹B`, by forward substitution in which a zero pivot gives
zero.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from sigmapoint.compiled.native import gram, materialized, product, small
from sigmapoint.linear_algebra.factors import left_looking, norm_rows, one_where_zero, safe_sqrt, solve_lower
from sigmapoint.linear_algebra.leading import leading

UNROLLED = 5
"""Up to this size Gram-Schmidt is written out, and takes no longer than by a Cholesky factor."""
PRODUCTS = 64
"""From this size on a library's products take less time than its reflections."""


def tria(
    A: Float[Array, "n k"], known: Float[Array, "n n"] | None = None, *, many: bool = False
) -> Float[Array, "n n"]:
    """Lower triangular `L` with `L Lᵀ = A Aᵀ` and a diagonal that is not negative, by orthogonalising the rows.

    A row of zeros after those above are taken out has a column of zeros, as in the Cholesky factor of `A Aᵀ`. A pivot
    far below the round-off of its row is kept: it is accurate, and a small variance is not a known one.

    Args:
        A: columns whose outer products add up to the covariance.
        known: a covariance that some of the columns of `A` are a (derivative-free) factor of. It adds nothing to the
            value; derivatives flow through it instead of through its factor, whose own derivative is infinite where
            the covariance is zero.
        many: this is one of many under `jax.vmap`. Libraries take those one after the other, on some machines with
            locks that wait for each other.
    """
    n = A.shape[0]
    form = _tria if small(n) else _tria_once
    return form(A, jnp.zeros((n, n), A.dtype) if known is None else known, many)


@partial(jax.custom_jvp, nondiff_argnums=(2,))
def _tria(A: Array, known: Array, many: bool) -> Array:
    return leading(orthogonalized(A, many=many)[0], A, known)


@_tria.defjvp
def _tria_jvp(many: bool, primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Array, Array]:
    (A, known), (dA, dknown) = primals, tangents
    fixed, fixed_known = jax.lax.stop_gradient((A, known))
    L, Q = orthogonalized(fixed, many=many)
    # For second derivatives: both again, the same in value, as functions of A and of `known`.
    L = L + _change(L, Q, A - fixed, known - fixed_known)
    rows = _resolved(L, A)
    Q = Q + (rows - jax.lax.stop_gradient(rows))
    return leading((L, _change(L, Q, dA, dknown)), A, known)


_tria_once = jax.jit(_tria, static_argnums=2)
"""Traced once for a size, however often a program has it."""


def _change(L: Array, Q: Array, dA: Array, dknown: Array) -> Array:
    """The change of L with A and `known`, to first order; see the module."""
    B = product(dA, Q.T) + 0.5 * _resolved(L, dknown).T
    K = jnp.triu(_resolved(L, B), 1)
    return jnp.tril(B - product(L, K - K.T))


def orthogonalized(A: Float[Array, "n k"], *, many: bool = False) -> tuple[Float[Array, "n n"], Float[Array, "n k"]]:
    """`L` and `Q` with `A = L Q`: `L` as in `tria`, the rows of `Q` orthonormal (zero where those of `L` are)."""
    n = A.shape[0]
    if many:
        return _row_by_row(A)
    if n <= UNROLLED and small(n):
        return _written_out(A)
    surely = _row_by_row if small(n) else _by_reflections
    if not small(n) and n < PRODUCTS:
        return surely(A)
    L, Q, good = _by_cholesky(A)
    return jax.lax.cond(good, lambda A: (L, Q), surely, A)


def _by_cholesky(A: Float[Array, "n k"]) -> tuple[Float[Array, "n n"], Float[Array, "n k"], Bool[Array, ""]]:
    """The same by the factor of `A Aᵀ`, and whether it is as good as by orthogonal transformations.

    What the factor has lost shows in `E = Q Qᵀ − I`, and is put back to second order (after the repeated Cholesky QR
    of Yamamoto, Nakatsukasa, Yanagisawa & Fukaya 2015): where E is small enough for that, nothing is left of it.
    """
    n = A.shape[0]
    P = gram(A.T)
    there = jnp.diagonal(P) != 0
    P = materialized(jnp.where(jnp.diag(~there), 1.0, P))
    L = materialized(left_looking(P) if small(n) else jnp.linalg.cholesky(P, symmetrize_input=False))
    Q = solve_lower(L, A)
    E = gram(Q.T) - jnp.diag(there.astype(A.dtype))
    H = _half(E)
    change = materialized(H - _half(gram(H.T)))
    L = jnp.where(there[:, None], jnp.tril(L + product(L, change)), 0.0)
    # (Not by the largest element: XLA's maximum passes over NaN.)
    good = (jnp.abs(E) < jnp.finfo(A.dtype).eps ** (1 / 3)).all()
    return L, Q - product(change, Q - product(change, Q)), good


def _half(S: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """The lower triangular `H` with `H + Hᵀ = S`."""
    n = S.shape[0]
    return S * ((np.tri(n) + np.tri(n, k=-1)) / 2).astype(S.dtype)


def _written_out(A: Float[Array, "n k"]) -> tuple[Float[Array, "n n"], Float[Array, "n k"]]:
    """As `_row_by_row`, without a loop: each row then meets those before it only."""
    n, k = A.shape
    rows, taken = [], jnp.zeros((0, k), A.dtype)
    for j in range(n):
        along, pivot, row = _projected(A[j], taken, unrolled=True)
        rows.append(materialized(jnp.append(along, pivot)))
        taken = jnp.concatenate([taken, materialized(row)[None]])
    return jnp.stack([jnp.pad(row, (0, n - 1 - j)) for j, row in enumerate(rows)]), taken


def _row_by_row(A: Float[Array, "n k"]) -> tuple[Float[Array, "n n"], Float[Array, "n k"]]:
    """The same by Gram-Schmidt, three times for every row.

    Round-off in a row is relative to each of its elements, so what the first pass leaves of large columns lies along
    the rows before, and the second pass takes it out: accurate row by row, also where columns differ by many orders of
    magnitude. (Giraud, Langou & Rozložník 2005: twice is enough.) The third tells a row that depends on those before.
    """
    n = A.shape[0]

    def take(carry: tuple[Array, Array], j: Array) -> tuple[tuple[Array, Array], None]:
        L, Q = carry
        along, pivot, row = _projected(A[j], Q, unrolled=False)
        along = jnp.where(jnp.arange(n) == j, pivot, along)
        return (L.at[j].set(along), Q.at[j].set(row)), None

    return jax.lax.scan(take, (jnp.zeros((n, n), A.dtype), jnp.zeros_like(A)), jnp.arange(n))[0]


def _projected(row: Array, Q: Float[Array, "j k"], *, unrolled: bool) -> tuple[Array, Array, Array]:
    """The components of a row along those of Q, the length of what is left, and its direction."""
    length = jnp.sum(row**2)

    def once_more(_: Any, carry: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        along, row, _, before = carry
        part = materialized(jnp.sum(Q * row[None, :], axis=1))
        row = materialized(row - jnp.sum(Q * part[:, None], axis=0))
        return along + part, row, before, jnp.sum(row**2)

    start = (jnp.zeros(Q.shape[0], row.dtype), row, length, length)
    along, row, before, after = jax.lax.fori_loop(0, 3, once_more, start, unroll=3 if unrolled else 1)
    # What a third pass still finds along the rows before is round-off that has no direction of its own.
    row = jnp.where(after < 0.5 * before, 0.0, row)
    pivot = safe_sqrt(jnp.sum(row**2))
    return along, pivot, row / one_where_zero(pivot)


def _by_reflections(A: Float[Array, "n k"]) -> tuple[Float[Array, "n n"], Float[Array, "n k"]]:
    """The same by LAPACK, columns sorted by size first: then it is accurate row by row as well (Cox & Higham 1998)."""
    n, k = A.shape
    order = jnp.argsort(-jnp.max(jnp.abs(A), axis=0))
    wide = jnp.pad(A[:, order], ((0, 0), (0, max(n - k, 0))))
    Q, R = jnp.linalg.qr(wide.T)
    sign = jnp.where(jnp.diagonal(R) < 0, -1.0, 1.0).astype(A.dtype)
    L, Q = jnp.tril(R.T * sign[None, :]), (Q * sign[None, :]).T
    # LAPACK gives a row that repeats those above some direction and a column; Cholesky's factor has zeros there.
    dead = jnp.diagonal(L) <= n * jnp.finfo(A.dtype).eps * norm_rows(A)
    Q = jnp.zeros((n, k), A.dtype).at[:, order].set(Q[:, :k])
    return jax.lax.cond(dead.any(), lambda: _row_by_row(A), lambda: (L, Q))


def _resolved(L: Array, b: Array) -> Array:
    """`L⁻¹ b` where pivots that are mere round-off of their row count as zero."""
    noise = jnp.finfo(L.dtype).eps * L.shape[0] * norm_rows(L)
    solid = jnp.abs(jnp.diagonal(L)) > noise
    return solve_lower(jnp.where(jnp.diag(~solid), 0.0, L), b)
