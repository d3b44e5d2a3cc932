"""Many series through one estimator: over devices or cores, of the same length or not.

On a CPU where loops are native, each series is one such loop, and one shorter than its neighbours just ends. Elsewhere
a piece of the batch runs in step (`jax.vmap`).
"""

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sigmapoint import checks
from sigmapoint.blackbox import unwrapped
from sigmapoint.breakdown import warned
from sigmapoint.checks import data_checks
from sigmapoint.compiled.series import of_each, one_by_one
from sigmapoint.filtering import Estimator, Forward, fitting, series_of
from sigmapoint.model import StateSpaceModel
from sigmapoint.ragged import Ragged, concatenated
from sigmapoint.recipe import Recipe
from sigmapoint.results import FIELDS
from sigmapoint.smoothing.smoother import Smoother, looking_back

LARGEST_PIECE = 256
"""Series that are worked through in one call."""
PIECES = 4
"""Calls for each worker at least, so that they end at about the same time."""
RATIO = {True: 8.0, False: 1.25}
"""How much longer than another a series of a piece may be, where they run one by one (which takes fewer programs), and
where they run in step (then the longest counts for all)."""


def batch(
    model: StateSpaceModel,
    y: Any,
    u: Any = None,
    method: Recipe | None = None,
    *,
    key: Array | int | None = None,
    smoother: Smoother | None = None,
    keep: tuple[str, ...] = FIELDS,
) -> Any:
    """Estimate the states of many series of one model, on all devices, or all cores of the CPU.

    Parameters that differ from series to series go into `u`. Inside `jax.jit` or `jax.grad` the whole batch is one
    program on one device.

    Args:
        model: the model.
        y: measurements (B, T, m); or a list of B arrays (Tᵢ, m), of different lengths.
        u: inputs, any pytree of arrays with leading axes (B, T); or a list of B pytrees with leading axis Tᵢ.
        method: as for `filter`.
        key: as for `filter`; series i draws with `jax.random.split(key, B)[i]`.
        smoother: how to look back, e.g. `rts()`; where not given, beliefs are filtered.
        keep: as for `filter`. What is kept decides over the memory.

    Returns:
        A `Posterior` whose fields have a leading axis B; for a list, a list of B `Posterior`.

    Raises:
        ValueError: as `filter`; an empty batch, series with different columns, as many `u` as `y`.

    Examples:
        >>> import jax.numpy as jnp, numpy as np, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> sp.batch(model, np.ones((10, 20, 1))).mean.shape
        (10, 20, 1)
        >>> [post.mean.shape for post in sp.batch(model, [np.ones((3, 1)), np.ones((5, 1))], smoother=sp.rts())]
        [(3, 1), (5, 1)]
    """
    ragged = isinstance(y, list | tuple)
    rows = concatenated(y, u) if ragged else _flattened(y, u)
    recipe, B = fitting(model, method), len(rows.lengths)
    keep = recipe.posterior.selected(keep)
    estimator: Estimator = Forward() if smoother is None else looking_back(smoother, recipe, model)
    keys = jax.tree.map(lambda key: jax.random.split(key, B), recipe.random(key))
    flat_y, flat_u = series_of(model, rows.y, rows.u, int(rows.lengths.max()))
    if not all(map(checks.known, jax.tree.leaves((model, flat_y, flat_u)))):
        y, u = _split((flat_y, flat_u), B)
        kept = _together(model, y, u, jnp.asarray(rows.lengths), keys, recipe, estimator, keep)
        return warned(recipe.posterior.of(model, y, u, kept))
    rows = Ragged(np.asarray(flat_y), jax.tree.map(np.asarray, flat_u), rows.starts, rows.lengths)
    found = _over_workers(list(_pieces(rows, one_by_one())), model, keys, recipe, estimator, keep)
    if ragged:
        every = jax.device_put([(*_series(rows, i), found[i]) for i in range(B)])
        return warned([recipe.posterior.of(model, *one) for one in every])
    y, u = _split((flat_y, flat_u), B)
    kept = jax.tree.map(lambda *each: jnp.asarray(np.stack(each)), *(found[i] for i in range(B)))
    return warned(recipe.posterior.of(model, y, u, kept))


def _split(tree: Any, B: int) -> Any:
    return jax.tree.map(lambda a: a.reshape(B, -1, *a.shape[1:]), tree)


def _flattened(y: Any, u: Any) -> Ragged:
    y = checks.array("y", y)
    if y.ndim != 3:
        raise ValueError(f"y of a batch must be (B, T, m), or a list of arrays (T, m), got shape {y.shape}")
    if 0 in y.shape:
        raise ValueError(f"y of a batch has shape {y.shape}: at least one series with one sample is needed")
    B, T = y.shape[:2]
    u = data_checks.inputs(u, B, y.dtype)

    def leaf(path: Any, value: Any) -> Array:
        made = jnp.asarray(value)
        if made.shape[:2] != (B, T):
            name = "u" + jax.tree_util.keystr(path)
            raise ValueError(f"{name} must have leading axes ({B}, {T}), as y, got shape {made.shape}")
        return made.reshape(B * T, *made.shape[2:])

    u = jax.tree_util.tree_map_with_path(leaf, u)
    return Ragged(y.reshape(B * T, -1), u, np.arange(B) * T, np.full(B, T))


def _series(rows: Ragged, i: int) -> tuple[np.ndarray, Any]:
    part = slice(rows.starts[i], rows.starts[i] + rows.lengths[i])
    y, u = jax.tree.map(lambda a: a[part], (rows.y, rows.u))
    return y, u


class Piece(NamedTuple):
    """Series of about one length, filled up to the same, and some without rows, for the same number in every piece."""

    members: np.ndarray
    y: Float[np.ndarray, "S T m"]
    u: Any
    lengths: Int[np.ndarray, " S"]


def _pieces(rows: Ragged, one_by_one: bool) -> Iterator[Piece]:
    longest_first = np.argsort(-rows.lengths, kind="stable")
    lengths = rows.lengths[longest_first]
    most = min(LARGEST_PIECE, -(-len(lengths) // (PIECES * _workers())))
    while len(longest_first):
        group = int(np.searchsorted(-lengths, -lengths[0] / RATIO[one_by_one], side="right"))
        # One size for all, where empty series cost nothing; else as equal as it goes within a group.
        size = most if one_by_one else -(-group // -(-group // most))
        T = int(lengths[0])
        for start in range(0, group, size):
            members = longest_first[start : min(start + size, group)]
            empty = size - len(members)
            held = np.pad(rows.held(members, T), ((0, empty), (0, 0)), mode="edge")
            y, u = jax.tree.map(lambda a, held=held: a[held], (rows.y, rows.u))
            yield Piece(members, y, u, np.pad(rows.lengths[members], (0, empty)))
        longest_first, lengths = longest_first[group:], lengths[group:]


def _workers() -> int:
    devices = jax.local_device_count()
    return devices if devices > 1 or jax.default_backend() != "cpu" else os.cpu_count() or 1


def _over_workers(
    pieces: list[Piece],
    model: StateSpaceModel,
    keys: Array | None,
    method: Recipe,
    estimator: Estimator,
    keep: tuple[str, ...],
) -> dict[int, dict[str, Any]]:
    """What was kept of each series, by its number."""
    devices = jax.local_devices()
    # A thread does not know of `with jax.enable_x64(True)`.
    of_the_caller = jax.dtypes.canonicalize_dtype(np.float64) == np.float64

    def work(i: int) -> list[tuple[int, dict[str, Any]]]:
        piece = pieces[i]
        members = np.pad(piece.members, (0, len(piece.y) - len(piece.members)), mode="edge")
        own = jax.tree.map(lambda keys: keys[members], keys)
        with jax.enable_x64(of_the_caller):
            y, u, lengths, own = jax.device_put((piece.y, piece.u, piece.lengths, own), devices[i % len(devices)])
            kept = unwrapped(_together, model, y, u, lengths, own, method, estimator, keep)
            kept = jax.tree.map(np.asarray, kept)

        def of(j: int) -> dict[str, Any]:
            return jax.tree.map(lambda v: np.asarray(v[j] if v.ndim == 1 else v[j, : piece.lengths[j]]), kept)

        return [(int(member), of(j)) for j, member in enumerate(piece.members)]

    pool = ThreadPoolExecutor(min(_workers(), len(pieces)))
    try:
        return dict(pair for pairs in pool.map(work, range(len(pieces))) for pair in pairs)
    finally:
        pool.shutdown(cancel_futures=True)


@eqx.filter_jit
def _together(
    model: StateSpaceModel,
    y: Float[Array, "S T m"],
    u: Any,
    lengths: Int[Array, " S"],
    keys: Array | None,
    method: Recipe,
    estimator: Estimator,
    keep: tuple[str, ...],
) -> dict[str, Any]:
    T = y.shape[1]

    def one(y: Array, u: Any, length: Array, key: Array | None) -> dict[str, Any]:
        real, run = jnp.arange(T) < length, method.ready(model, key)
        return estimator(run, jnp.where(real[:, None], y, jnp.nan), u, keep, real)

    return of_each(one, y, u, lengths, keys)
