"""Small linear algebra on covariance factors that never breaks.

A covariance `P` is carried as a lower factor `L` with `P = L Lᵀ`. The operations here are all that the filters
need, and each is defined for positive *semi*-definite matrices: a variance of zero gives a zero column, not a NaN, and
derivatives stay finite there.

Derivative of the triangularisation. With `A = L Q` (Q with orthonormal rows) and `B = dA Qᵀ`, the covariance moves by
`B Lᵀ + L Bᵀ`. Any antisymmetric `K` may be taken off, `dL = B − L K`, and `K` is chosen row by row so that `dL` is
lower triangular: the strictly upper part of `K` is that of `L⁻¹B`, by forward substitution in which a zero pivot gives
zero.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


def cholesky(P: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Lower factor of a positive semi-definite matrix, column by column.

    A pivot that is not above round-off of its own diagonal element gives a zero column, so that a singular (or, by
    round-off, slightly indefinite) matrix has a finite factor. The lower triangle of `P` is read.
    """
    n = P.shape[0]
    floor = jnp.finfo(P.dtype).eps * jnp.diagonal(P)
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
    regular = jnp.diagonal(S) != 0
    S = jnp.where(regular[:, None] & regular[None, :], S, jnp.eye(S.shape[0], dtype=S.dtype))
    b = jnp.where(regular.reshape((-1,) + (1,) * (b.ndim - 1)), b, 0.0)
    return jax.scipy.linalg.solve_triangular(S, b, lower=True, trans=transposed)


def safe_sqrt(x: Float[Array, " n"]) -> Float[Array, " n"]:
    """Square root with a derivative of zero (not infinity) at zero."""
    return jnp.where(x == 0, 0.0, jnp.sqrt(jnp.where(x == 0, 1.0, x)))


def norm_rows(A: Float[Array, "n k"]) -> Float[Array, " n"]:
    """Euclidean norm of each row, with a derivative of zero (not NaN) at a zero row."""
    squares = jnp.sum(A * A, axis=1)
    return safe_sqrt(squares)


def tria(A: Float[Array, "n k"], known: Float[Array, "n n"] | None = None) -> Float[Array, "n n"]:
    """Lower triangular `L` with `L Lᵀ = A Aᵀ` and a diagonal that is not negative, by Householder reflections.

    Args:
        A: columns whose outer products add up to the covariance.
        known: a covariance that some of the columns of `A` are a (derivative-free) factor of. It adds nothing to the
            value; derivatives flow through it instead of through its factor, whose own derivative is infinite where
            the covariance is zero.
    """
    n, k = A.shape
    if k < n:
        A = jnp.concatenate([A, jnp.zeros((n, n - k), A.dtype)], axis=1)
    return _tria(A, jnp.zeros((n, n), A.dtype) if known is None else known)


@jax.custom_jvp
def _tria(A: Array, known: Array) -> Array:
    del known
    R = jnp.linalg.qr(_largest_first(A, A).T, mode="r")
    return R.T * _signs(R)[None, :]


@_tria.defjvp
def _tria_jvp(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    (A, known), (dA, dknown) = primals, tangents
    A, dA = _largest_first(A, A), _largest_first(dA, A)
    fixed, fixed_known = jax.lax.stop_gradient((A, known))
    Q, R = jnp.linalg.qr(fixed.T)
    Q, L = Q * _signs(R)[None, :], R.T * _signs(R)[None, :]
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


def independent_rows(A: Float[Array, "d k"]) -> Bool[Array, " d"]:
    """Which rows are, beyond round-off, not combinations of the rows before them (a zero row is not).

    Each row that is independent takes one direction out of all others, by a Householder reflection that puts it on the
    axis of its largest element.
    """
    A = jax.lax.stop_gradient(A)
    floor = 32 * jnp.finfo(A.dtype).eps * jnp.sqrt(A.shape[1]) * norm_rows(A)

    def take(j: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        A, independent = carry
        row = A[j]
        size = jnp.linalg.norm(row)
        alive = ~((size <= floor[j]) & jnp.isfinite(size))
        axis = jax.nn.one_hot(jnp.argmax(jnp.abs(row)), A.shape[1], dtype=A.dtype)
        v = row + jnp.where(row @ axis < 0, -size, size) * axis
        reflected = A - jnp.outer(A @ v, v) * (2 / jnp.where(alive, v @ v, 1.0))
        A = jnp.where(alive, reflected * (1 - axis)[None, :], A)
        return A, independent.at[j].set(alive)

    start = (A, jnp.zeros(A.shape[0], bool))
    return jax.lax.fori_loop(0, A.shape[0], take, start)[1]


def _largest_first(A: Array, like: Array) -> Array:
    """Columns in falling order of their largest element: reflections are then accurate row by row (Cox & Higham 1998),
    also where rows differ by many orders of magnitude."""
    return A[:, jnp.argsort(-jnp.max(jnp.abs(like), axis=0))]


def _signs(R: Array) -> Array:
    return jnp.where(jnp.diagonal(R) < 0, -1.0, 1.0).astype(R.dtype)


def _resolved(L: Array, b: Array) -> Array:
    """`L⁻¹ b` where pivots that are mere round-off of their row count as zero."""
    pivots = jnp.diagonal(L)
    noise = jnp.finfo(L.dtype).eps * L.shape[0] * norm_rows(L)
    solid = jnp.abs(pivots) > noise
    return solve_lower(jnp.where(jnp.diag(~solid), 0.0, L), b)
