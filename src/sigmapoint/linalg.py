"""Small linear algebra on covariance factors that never breaks.

A covariance `P` is carried as a lower factor `L` with `P = L Lᵀ`. The operations here are all that the filters
need, and each is defined for positive *semi*-definite matrices: a variance of zero gives a zero column, not a NaN, and
derivatives stay finite there.

Derivative of the triangularisation. With `A = L Q` (Q with orthonormal rows) and `B = dA Qᵀ`, the covariance moves by
`B Lᵀ + L Bᵀ`. Any antisymmetric `K` may be taken off, `dL = B − L K`, and `K` is chosen row by row so that `dL` is
lower triangular: the strictly upper part of `K` is that of `L⁻¹B`, by forward substitution in which a zero pivot gives
zero.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

LARGEST_UNROLLED = 16
"""Up to this size an algorithm is a few array operations for each row, which compile into one loop-free function."""


def cholesky(P: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Lower factor of a positive semi-definite matrix, column by column.

    A pivot that is not above round-off of its own diagonal element gives a zero column, so that a singular (or, by
    round-off, slightly indefinite) matrix has a finite factor. The lower triangle of `P` is read.
    """
    n = P.shape[0]
    floor = n * jnp.finfo(P.dtype).eps * jnp.diagonal(P)
    columns, rest = [], P
    for j in range(n):
        pivot = rest[j, j]
        # False for NaN and infinity, which go on as NaN: an unknown variance is not a known zero.
        singular = (pivot <= floor[j]) & jnp.isfinite(pivot)
        root = jnp.sqrt(jnp.where(singular, 1.0, pivot))
        column = jnp.where((jnp.arange(n) < j) | singular, 0.0, rest[:, j] / root)
        columns.append(column)
        rest = rest - jnp.outer(column, column)
    return jnp.stack(columns, axis=1)


def solve_lower(S: Float[Array, "n n"], b: Float[Array, "n *k"]) -> Float[Array, "n *k"]:
    """`S⁻¹ b` by forward substitution; a row with a zero pivot gives zero."""
    return _solve(S, b, transposed=0)


def solve_upper(S: Float[Array, "n n"], b: Float[Array, "n *k"]) -> Float[Array, "n *k"]:
    """`S⁻ᵀ b` for lower `S` by back substitution; a row with a zero pivot gives zero."""
    return _solve(S, b, transposed=1)


def _solve(S: Array, b: Array, transposed: int) -> Array:
    n = S.shape[0]
    regular = jnp.diagonal(S) != 0
    if n > LARGEST_UNROLLED:
        S = jnp.where(regular[:, None] & regular[None, :], S, jnp.eye(n, dtype=S.dtype))
        b = jnp.where(regular.reshape((-1,) + (1,) * (b.ndim - 1)), b, 0.0)
        return jax.scipy.linalg.solve_triangular(S, b, lower=True, trans=transposed)
    rest, rows = b.reshape(n, -1), [b] * n
    columns = S.T if transposed else S
    for j in reversed(range(n)) if transposed else range(n):
        rows[j] = jnp.where(regular[j], rest[j] / one_where_zero(S[j, j]), 0.0)
        rest = rest - jnp.outer(columns[:, j], rows[j])
    return jnp.stack(rows).reshape(b.shape)


def safe_sqrt(x: Float[Array, " n"]) -> Float[Array, " n"]:
    """Square root with a derivative of zero (not infinity) at zero."""
    return jnp.where(x == 0, 0.0, jnp.sqrt(jnp.where(x == 0, 1.0, x)))


def one_where_zero(x: Array) -> Array:
    """A divisor that is never zero."""
    return jnp.where(x == 0, 1.0, x)


def norm_rows(A: Float[Array, "n k"]) -> Float[Array, " n"]:
    """Euclidean norm of each row, with a derivative of zero (not NaN) at a zero row."""
    squares = jnp.sum(A * A, axis=1)
    return safe_sqrt(squares)


def tria(A: Float[Array, "n k"], known: Float[Array, "n n"] | None = None) -> Float[Array, "n n"]:
    """Lower triangular `L` with `L Lᵀ = A Aᵀ` and a diagonal that is not negative, by Householder reflections.

    A row of zeros after those above are taken out has a column of zeros, as in the Cholesky factor of `A Aᵀ`. A pivot
    far below the round-off of its row is kept: it is accurate, and a small variance is not a known one.

    Args:
        A: columns whose outer products add up to the covariance.
        known: a covariance that some of the columns of `A` are a (derivative-free) factor of. It adds nothing to the
            value; derivatives flow through it instead of through its factor, whose own derivative is infinite where
            the covariance is zero.
    """
    n = A.shape[0]
    return _tria(A, jnp.zeros((n, n), A.dtype) if known is None else known)


@jax.custom_jvp
def _tria(A: Array, known: Array) -> Array:
    del known
    return _reflected(A, A.shape[0])


@_tria.defjvp
def _tria_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Array, Array]:
    (A, known), (dA, dknown) = primals, tangents
    n, k = A.shape
    fixed, fixed_known = jax.lax.stop_gradient((A, known))
    both = _reflected(jnp.concatenate([fixed, jnp.eye(k, dtype=A.dtype)]), n)
    L, Q = both[:n], both[n:]
    # For second derivatives: both again, the same in value, as functions of A and of `known`.
    L = L + _change(L, Q, A - fixed, known - fixed_known)
    rows = _resolved(L, A)
    Q = Q + (rows - jax.lax.stop_gradient(rows)).T
    return L, _change(L, Q, dA, dknown)


def _change(L: Array, Q: Array, dA: Array, dknown: Array) -> Array:
    """The change of L with A and `known`, to first order; see the module."""
    B = dA @ Q + 0.5 * _resolved(L, dknown).T
    K = jnp.triu(_resolved(L, B), 1)
    return jnp.tril(B - L @ (K - K.T))


def _reflected(A: Float[Array, "r k"], n: int) -> Float[Array, "r n"]:
    """`A Q` for the orthonormal `Q` that makes its first `n` rows lower triangular.

    Every row takes the direction of its largest element out of those below: with that choice reflections are accurate
    row by row, also where rows differ by many orders of magnitude (Cox & Higham 1998). A row of zeros takes nothing
    and leaves a column of zeros.
    """
    columns = []
    if A.shape[1] == 0:
        return jnp.zeros((A.shape[0], n), A.dtype)
    for j in range(n):
        column, A = _reflect(A)
        columns.append(jnp.pad(column, (j, 0)))
    return jnp.stack(columns, axis=1)


def _reflect(A: Float[Array, "r k"]) -> tuple[Float[Array, " r"], Float[Array, "s k"]]:
    """The first row's length and the others' components along it; and the others without its largest element's axis."""
    row, rest = A[0], A[1:]
    k = row.shape[0]
    axis = (jnp.arange(k) == jnp.argmax(jnp.abs(row))).astype(A.dtype)
    largest = row @ axis
    # The sign that adds. False for NaN and infinity, which go on as NaN: an unknown variance is not a known zero.
    sign = jnp.where(largest < 0, -1.0, 1.0).astype(A.dtype)
    scale = one_where_zero(jnp.abs(largest))
    row = row * (sign / scale)
    size = jnp.sqrt(row @ row)
    along = rest @ (row / one_where_zero(size))
    v = (row + size * axis) / (1 + size)
    left = (rest - jnp.outer(along + rest @ axis, v)) * (1 - axis)[None, :]
    return jnp.concatenate([(scale * size)[None], sign * along]), jnp.where(largest == 0, rest, left)


def _resolved(L: Array, b: Array) -> Array:
    """`L⁻¹ b` where pivots that are mere round-off of their row count as zero."""
    noise = jnp.finfo(L.dtype).eps * L.shape[0] * norm_rows(L)
    solid = jnp.abs(jnp.diagonal(L)) > noise
    return solve_lower(jnp.where(jnp.diag(~solid), 0.0, L), b)
