"""The posterior factor in O(M L²), block by block and without a downdate.

Parameters `w = m + S ξ` are seen through `y = ȳ + Φ ξ + noise`, the noise with lower factor C. An orthogonal matrix
that makes the top of an array lower triangular turns

    [ C  Φ ]          [ C⁺  0 ]
    [ 0  S ]   into   [ K̄   S⁺ ]

with C⁺ C⁺ᵀ the covariance of y, K̄ C⁺⁻¹ the gain, and S⁺ the factor after the measurement: the array form of the update
(Kailath, Sayed & Hassibi 2000, section 12.3). Taken over blocks of B columns of S, the last one first, each orthogonal
matrix is of size M+B only, found from [C Φ_B; 0 I] alone, and

* its lower right corner is lower triangular, so S stays so: the next block is not touched by those behind it;
* S is read and written once, by matrix products.

With B = 1 and M = 1 this is Carlson's update (1973); his closed form serves for blocks of any size, row by row. The
factor is kept as `U = Sᵀ`, whose rows are the columns of S: a block is then one piece of memory.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint.linear_algebra.factors import one_where_zero
from sigmapoint.linear_algebra.triangularization import orthogonalized

BLOCK = 16
"""Columns in a block, about."""
FEW = 4
"""Up to so many targets the rotation of a block is written down row by row; it takes a fourth of the time then."""
GROUPS = 4
"""Parts of the factor in which the columns left of the diagonal are left out, on one device."""


class Conditioned(NamedTuple):
    """What a measurement makes of a factor."""

    columns: Float[Array, "L L"]
    """S⁺ᵀ"""
    gain: Float[Array, "M L"]
    """K̄ᵀ"""
    factor: Float[Array, "M M"]
    """C⁺"""
    variance: Float[Array, " L"]
    """diagonal of S⁺ S⁺ᵀ"""


def conditioned(
    columns: Float[Array, "L L"], slope: Float[Array, "M L"], factor: Float[Array, "M M"], groups: int = GROUPS
) -> Conditioned:
    """The factor S = `columns`ᵀ after a measurement with this slope and this factor of its noise.

    `groups`: parts of the factor, each without the columns that are zero in all of it. With one, rows of S are all
    treated alike, as they must be where they are on several devices.
    """
    L, M = columns.shape[0], slope.shape[0]
    given = Conditioned(columns, jnp.zeros((M, L), columns.dtype), factor, jnp.zeros(L, columns.dtype))
    size = min(BLOCK, L)
    blocks, rest = divmod(L, size)
    if rest:
        given = _taken(given, slope, L - rest, rest, L - rest if groups > 1 else 0)
    for group in reversed(range(groups)):
        first, last = blocks * group // groups, blocks * (group + 1) // groups

        def one(i: Array, given: Conditioned, first: int = first, last: int = last) -> Conditioned:
            return _taken(given, slope, (last - 1 - i) * size, size, first * size)

        given = jax.lax.fori_loop(0, last - first, one, given) if last > first else given
    return given


def _taken(given: Conditioned, slope: Array, start: Array | int, size: int, left: int) -> Conditioned:
    """After the columns from `start` on; all before `left` is zero in them."""
    L, M = given.columns.shape[0], slope.shape[0]
    phi = jax.lax.dynamic_slice_in_dim(slope, start, size, 1)
    C, Q = (_row_by_row if M <= FEW else _by_reflections)(given.factor, phi)
    block = jax.lax.dynamic_slice(given.columns, (start, left), (size, L - left))
    both = Q @ jnp.concatenate([given.gain[:, left:], block])
    after = both[M:]
    return Conditioned(
        jax.lax.dynamic_update_slice(given.columns, after, (start, left)),
        given.gain.at[:, left:].set(both[:M]),
        C,
        given.variance.at[left:].add(jnp.sum(after**2, axis=0)),
    )


def _row_by_row(C: Float[Array, "M M"], phi: Float[Array, "M B"]) -> tuple[Array, Float[Array, "N N"]]:
    """C⁺ and the orthogonal Q with [C Φ; 0 I] Qᵀ lower triangular, one row of Φ after the other."""
    M, B = phi.shape
    eye = jnp.eye(M + B, dtype=phi.dtype)
    both = jnp.concatenate([jnp.concatenate([C, phi], axis=1), eye])
    for k in range(M):
        turned = jnp.concatenate([both[:, k : k + 1], both[:, M:]], axis=1)
        turned = turned @ _annihilating(turned[k])
        both = jnp.concatenate([both[:, :k], turned[:, :1], both[:, k + 1 : M], turned[:, 1:]], axis=1)
    return both[:M, :M], both[M:].T


def _annihilating(v: Float[Array, " N"]) -> Float[Array, "N N"]:
    """The orthogonal G with vᵀ G = (|v|, 0, …, 0) that is lower triangular but for its first row (Carlson 1973).

    With v = (c, φ) and ρⱼ² = c² + φⱼ² + … + φ_B², column j is eⱼ ρⱼ₊₁/ρⱼ − (c, 0, …, 0, φⱼ₊₁, …, φ_B) φⱼ/(ρⱼ₊₁ρⱼ).
    """
    B = v.shape[0] - 1
    squares = jnp.where(np.tri(B, B + 1, dtype=bool), v[1:, None] ** 2, 0.0)
    rho = jnp.sqrt(v[0] ** 2 + jnp.sum(squares, axis=0))
    behind, here = rho[1:], rho[:-1]
    kept = jnp.where(here == 0, 1.0, behind / one_where_zero(here))
    scaled = v[1:] / one_where_zero(here) / one_where_zero(behind)
    taken = np.concatenate([np.ones((1, B), bool), np.tri(B, k=-1, dtype=bool)])
    rest = jnp.pad(jnp.diag(kept), ((1, 0), (0, 0))) - jnp.where(taken, v[:, None] * scaled[None, :], 0.0)
    first = jnp.where(rho[0] == 0, jnp.eye(B + 1, dtype=v.dtype)[0], v / one_where_zero(rho[0]))
    return jnp.concatenate([first[:, None], rest], axis=1)


def _by_reflections(
    C: Float[Array, "M M"], phi: Float[Array, "M B"]
) -> tuple[Float[Array, "M M"], Float[Array, "N N"]]:
    """The same by a triangularisation."""
    M, B = phi.shape
    eye = jnp.eye(B, dtype=phi.dtype)
    L, Q = orthogonalized(jnp.block([[C, phi], [jnp.zeros((B, M), phi.dtype), eye]]))
    # [0 I] Qᵀ is what stands below C⁺, exactly triangular there.
    return L[:M, :M], jnp.concatenate([Q[:, :M], L[M:].T], axis=1)
