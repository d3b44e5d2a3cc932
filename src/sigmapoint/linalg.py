"""Small linear algebra on covariance factors that never breaks.

A covariance `P` is carried as a lower factor `L` with `P = L Lᵀ`. The operations here are all that the filters
need, and each is defined for positive *semi*-definite matrices: a variance of zero gives a zero column, not a NaN, and
derivatives stay finite there.

Derivative of the triangularisation. With `A = L Q` (Q with orthonormal rows) and `B = dA Qᵀ`, the covariance moves by
`B Lᵀ + L Bᵀ`. Any antisymmetric `K` may be taken off, `dL = B − L K`, and `K` is chosen row by row so that `dL` is
lower triangular: the strictly upper part of `K` is that of `L⁻¹B`, by forward substitution in which a zero pivot gives
zero.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


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


def tria(A: Float[Array, "n k"], known: Float[Array, "n n"] | None = None, *, tested: int = 0) -> Float[Array, "n n"]:
    """Lower triangular `L` with `L Lᵀ = A Aᵀ` and a diagonal that is not negative, by Householder reflections.

    A row that is a combination of those above it has a pivot of zero and a column of zeros, as in the Cholesky factor
    of `A Aᵀ`: the factor of a singular covariance is the same in either form.

    Args:
        A: columns whose outer products add up to the covariance.
        known: a covariance that some of the columns of `A` are a (derivative-free) factor of. It adds nothing to the
            value; derivatives flow through it instead of through its factor, whose own derivative is infinite where
            the covariance is zero.
        tested: how many of the first rows count as combinations of those above already where that is so up to
            round-off. Of the others, a pivot far below the round-off of its row is kept: it is accurate, and a small
            variance is not a known one.
    """
    n = A.shape[0]
    return _tria(tested, A, jnp.zeros((n, n), A.dtype) if known is None else known)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _tria(tested: int, A: Array, known: Array) -> Array:
    del known
    return _reflected(A, A.shape[0], tested)


@_tria.defjvp
def _tria_jvp(tested: int, primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    (A, known), (dA, dknown) = primals, tangents
    n, k = A.shape
    fixed, fixed_known = jax.lax.stop_gradient((A, known))
    both = _reflected(jnp.concatenate([fixed, jnp.eye(k, dtype=A.dtype)]), n, tested)
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


def _reflected(A: Float[Array, "r k"], n: int, tested: int) -> Float[Array, "r n"]:
    """`A Q` for the orthonormal `Q` that makes its first `n` rows lower triangular.

    Every row that is not a combination of those above takes the direction of its largest element out of all others:
    with that choice reflections are accurate row by row, also where rows differ by many orders of magnitude (Cox &
    Higham 1998). A row that is such a combination takes nothing and leaves a column of zeros.
    """
    r, k = A.shape
    floor = jnp.where(jnp.arange(n) < tested, 32 * jnp.finfo(A.dtype).eps * jnp.sum(jnp.abs(A[:n]), axis=1), 0.0)

    def take(j: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        A, columns = carry
        row = A[j]
        axis = jax.nn.one_hot(jnp.argmax(jnp.abs(row)), k, dtype=A.dtype)
        largest = row @ axis
        row = row / _or_one(largest)
        size = jnp.sqrt(row @ row)
        # False for NaN and infinity, which go on as NaN: an unknown variance is not a known zero.
        dead = (jnp.abs(largest) * size <= floor[j]) & jnp.isfinite(largest)
        v = row + size * axis
        reflected = A - jnp.outer(A @ v, v) * (2 / jnp.where(dead, 1.0, v @ v))
        column = jnp.where(dead, 0.0, -jnp.sign(largest) * (reflected @ axis))
        column = jnp.where((jnp.arange(r) < j) & (jnp.arange(r) < n), 0.0, column)
        A = jnp.where(dead, A, reflected * (1 - axis)[None, :])
        return A.at[j].set(0.0), columns.at[:, j].set(column)

    return jax.lax.fori_loop(0, n, take, (A, jnp.zeros((r, n), A.dtype)))[1]


def _resolved(L: Array, b: Array) -> Array:
    """`L⁻¹ b` where pivots that are mere round-off of their row count as zero."""
    noise = jnp.finfo(L.dtype).eps * L.shape[0] * norm_rows(L)
    solid = jnp.abs(jnp.diagonal(L)) > noise
    return solve_lower(jnp.where(jnp.diag(~solid), 0.0, L), b)


def _or_one(x: Array) -> Array:
    return jnp.where(x == 0, 1.0, x)
