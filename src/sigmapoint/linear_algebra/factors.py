"""Small linear algebra on covariance factors that never breaks.

A covariance `P` is carried as a lower factor `L` with `P = L Lᵀ`. The operations here are all that the filters
need, and each is defined for positive *semi*-definite matrices: a variance of zero gives a zero column, not a NaN, and
derivatives stay finite there.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint.compiled.native import materialized, small
from sigmapoint.linear_algebra.leading import leading


def cholesky(P: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Lower factor of a positive semi-definite matrix, column by column.

    A pivot that is not above round-off of its own diagonal element gives a zero column, so that a singular (or, by
    round-off, slightly indefinite) matrix has a finite factor. The lower triangle of `P` is read.
    """
    return left_looking(P) if small(P.shape[0]) else _by_lapack_once(P)


def _scale(pivot: Array, floor: Array) -> Array:
    """What to multiply a column by: one over the root of its pivot; zero where that is singular."""
    # False for NaN and infinity, which go on as NaN: an unknown variance is not a known zero.
    singular = (pivot <= floor) & jnp.isfinite(pivot)
    return jnp.where(singular, 0.0, 1 / jnp.sqrt(jnp.where(singular, 1.0, pivot)))


def left_looking(P: Float[Array, "n n"]) -> Float[Array, "n n"]:
    n = P.shape[0]
    columns: list[Array] = []
    for j in range(n):
        rest = P[j:, j]
        for column in columns:
            rest = rest - column[j - n :] * column[j - n]
        scale = _scale(rest[0], n * jnp.finfo(P.dtype).eps * P[j, j])
        columns.append(materialized(rest * scale))
    return jnp.stack([jnp.pad(column, (j, 0)) for j, column in enumerate(columns)]).T


@jax.custom_jvp
def _by_lapack(P: Float[Array, "n n"]) -> Float[Array, "n n"]:
    L = jnp.linalg.cholesky(P, symmetrize_input=False)
    tiny = jnp.diagonal(L) ** 2 <= P.shape[0] * jnp.finfo(P.dtype).eps * jnp.diagonal(P)
    return leading(jax.lax.cond(jnp.isfinite(L).all() & ~tiny.any(), lambda: L, lambda: _right_looking(P)), P)


@_by_lapack.defjvp
def _by_lapack_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Array, Array]:
    # LAPACK's has no finite derivative where P is singular.
    return leading(jax.jvp(_right_looking, primals, tangents), primals)


_by_lapack_once = jax.jit(_by_lapack)
"""Traced once for a size, however often a program has it."""


def _right_looking(P: Float[Array, "n n"]) -> Float[Array, "n n"]:
    n = P.shape[0]
    floor = n * jnp.finfo(P.dtype).eps * jnp.diagonal(P)

    def take(carry: tuple[Array, Array], j: Array) -> tuple[tuple[Array, Array], None]:
        rest, L = carry
        scale = _scale(rest[j, j], floor[j])
        column = jnp.where(jnp.arange(n) < j, 0.0, rest[:, j] * scale)
        return (rest - jnp.outer(column, column), L.at[:, j].set(column)), None

    return jax.lax.scan(take, (P, jnp.zeros_like(P)), jnp.arange(n))[0][1]


def solve_lower(S: Float[Array, "n n"], b: Float[Array, "n *k"], *, many: bool = False) -> Float[Array, "n *k"]:
    """`S⁻¹ b` by forward substitution; a row with a zero pivot gives zero. `many`: as in `tria`."""
    return _solve(S, b, 0, many)


def solve_upper(S: Float[Array, "n n"], b: Float[Array, "n *k"], *, many: bool = False) -> Float[Array, "n *k"]:
    """`S⁻ᵀ b` for lower `S` by back substitution; a row with a zero pivot gives zero. `many`: as in `tria`."""
    return _solve(S, b, 1, many)


def _solve(S: Array, b: Array, transposed: int, many: bool) -> Array:
    n = S.shape[0]
    regular = jnp.diagonal(S) != 0
    if not (many or small(n)):
        S = jnp.where(regular[:, None] & regular[None, :], S, jnp.eye(n, dtype=S.dtype))
        b = jnp.where(regular.reshape((-1,) + (1,) * (b.ndim - 1)), b, 0.0)
        return jax.scipy.linalg.solve_triangular(S, b, lower=True, trans=transposed)
    inverse = jnp.where(regular, 1 / one_where_zero(jnp.diagonal(S)), 0.0)
    columns, rows = S.T if transposed else S, b.reshape(n, -1)
    solved: dict[int, Array] = {}
    for j in reversed(range(n)) if transposed else range(n):
        row = rows[j]
        for i, known in solved.items():
            row = row - columns[j, i] * known
        solved[j] = materialized(row * inverse[j])
    return jnp.stack([solved[j] for j in range(n)]).reshape(b.shape)


def safe_sqrt(x: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Square root with a derivative of zero (not infinity) at zero."""
    return jnp.where(x == 0, 0.0, jnp.sqrt(jnp.where(x == 0, 1.0, x)))


def one_where_zero(x: Array) -> Array:
    """A divisor that is never zero."""
    return jnp.where(x == 0, 1.0, x)


def norm_rows(A: Float[Array, "n k"]) -> Float[Array, " n"]:
    """Euclidean norm of each row, with a derivative of zero (not NaN) at a zero row."""
    squares = jnp.sum(A * A, axis=1)
    return safe_sqrt(squares)
