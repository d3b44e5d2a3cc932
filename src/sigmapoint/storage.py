"""Save and load states and results, without pickle, atomically.

A file is a NumPy `.npz` archive of the leaves of a pytree in order, with their paths. It is written beside its place
and renamed, so that a reader, or a crash, never meets half of one.
"""

import errno
import os
import tempfile
import zipfile
from collections.abc import Callable
from functools import reduce
from pathlib import Path
from typing import IO, Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

Tree = TypeVar("Tree")
_PATHS = "paths"
PARTS = ("theta", "estimates", "state", "model.process_noise", "model.observation_noise", "model.initial")
"""What results with functions in them have to save."""


def save(path: str | os.PathLike[str], tree: Any) -> None:
    """Write the arrays of `tree` (an online state, a posterior, any pytree of arrays) to `path`.

    Args:
        path: the file; replaced as a whole if it is there.
        tree: what to save.

    Raises:
        OSError: the place cannot be written, or the disk is full; what was at `path` stays as it was.
        ValueError: a path that is none; a leaf that is not an array or number.

    Examples:
        >>> import tempfile, pathlib, jax.numpy as jnp, sigmapoint as sp
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     sp.save(pathlib.Path(folder) / "state.npz", {"a": jnp.arange(3.0)})
        ...     s = sp.load(pathlib.Path(folder) / "state.npz", like={"a": jnp.zeros(3)})
        >>> s["a"].tolist()
        [0.0, 1.0, 2.0]
    """
    _check_path("save", path, "tree")
    leaves = jax.tree_util.tree_leaves_with_path(tree)
    arrays = {f"leaf{i}": np.asarray(jax.device_get(_data(leaf))) for i, (_, leaf) in enumerate(leaves)}
    for (where, leaf), array in zip(leaves, arrays.values()):
        if array.dtype == object:
            name, kind = jax.tree_util.keystr(where), type(leaf).__name__
            raise ValueError(f"save: {name} is not an array but {kind}; {_instead(tree)}")
    arrays[_PATHS] = np.array([jax.tree_util.keystr(where) for where, _ in leaves], dtype=np.str_)
    write_atomically(path, lambda file: np.savez(file, allow_pickle=False, **arrays))


def load(path: str | os.PathLike[str], like: Tree) -> Tree:
    """Read what `save` wrote, in the structure of `like`.

    Args:
        path: the file.
        like: a tree of the same structure, shapes and dtypes, for instance a fresh `init()`; of arrays, or of
            `jax.ShapeDtypeStruct` as `jax.eval_shape` makes them without computing anything.

    Raises:
        FileNotFoundError: no such file.
        ValueError: a path that is none; not a file of `save`, or one of another structure: the message names the first
            difference.

    Examples:
        >>> import tempfile, pathlib, jax, jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> live = sp.online(model)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     sp.save(pathlib.Path(folder) / "state.npz", live.predict(live.init()))
        ...     state = sp.load(pathlib.Path(folder) / "state.npz", like=live.init())
        >>> int(state.step)
        1

        A result, in a process that has the model but not the result: T rows were filtered.

        >>> T = 4
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     sp.save(pathlib.Path(folder) / "post.npz", sp.filter(model, jnp.ones((T, 1))))
        ...     like = jax.eval_shape(lambda: sp.filter(model, jnp.zeros((T, 1))))
        ...     post = sp.load(pathlib.Path(folder) / "post.npz", like=like)
        >>> post.mean.shape
        (4, 1)
    """
    _check_path("load", path, "like")
    try:
        with np.load(path, allow_pickle=False) as archive:
            stored = {name: archive[name] for name in archive.files}
        paths = [str(p) for p in stored.pop(_PATHS)]
    except (zipfile.BadZipFile, KeyError, ValueError, EOFError, AttributeError, TypeError) as error:
        raise ValueError(f"load: {os.fspath(path)} was not written by sp.save") from error
    leaves, structure = jax.tree_util.tree_flatten_with_path(like)
    wanted = [jax.tree_util.keystr(where) for where, _ in leaves]
    if paths != wanted:
        different = sorted(set(paths) ^ set(wanted)) or wanted
        raise ValueError(
            f"load: {os.fspath(path)} holds another structure than `like`; they differ at {different[0]!r}"
        )
    restored = []
    for i, (where, leaf) in enumerate(leaves):
        array, plain = stored[f"leaf{i}"], jax.eval_shape(_data, leaf)
        shape, dtype = plain.shape, plain.dtype
        if array.shape != shape or array.dtype != dtype:
            name = jax.tree_util.keystr(where)
            raise ValueError(f"load: {name} is {array.dtype}{array.shape} in the file but {dtype}{shape} in `like`")
        restored.append(_like(leaf, jnp.asarray(array)))
    return jax.tree_util.tree_unflatten(structure, restored)


def _is_key(leaf: Any) -> bool:
    return jnp.issubdtype(getattr(leaf, "dtype", float), jax.dtypes.prng_key)


def _data(leaf: Any) -> Any:
    """A random key as the numbers it is made of; anything else as it is."""
    return jax.random.key_data(leaf) if _is_key(leaf) else leaf


def _like(leaf: Any, array: Any) -> Any:
    """A random key again, where `leaf` is one."""
    return jax.random.wrap_key_data(array, impl=jax.random.key_impl(leaf)) if _is_key(leaf) else array


def _check_path(what: str, path: Any, other: str) -> None:
    if not isinstance(path, str | os.PathLike):
        kind = type(path).__name__
        raise ValueError(f"{what}: path must be the name of a file, got {kind}; it comes first: {what}(path, {other})")


def _instead(tree: Any) -> str:
    """Which parts of it can be saved."""
    there = [name for name in PARTS if _is_numbers(reduce(lambda a, b: getattr(a, b, None), name.split("."), tree))]
    return f"save its .{', .'.join(there)}" if there else "functions are not saved, the numbers that they use are"


def _is_numbers(tree: Any) -> bool:
    leaves = jax.tree.leaves(tree)
    return bool(leaves) and all(np.asarray(jax.device_get(_data(leaf))).dtype != object for leaf in leaves)


def write_atomically(path: str | os.PathLike[str], write: Callable[[IO[bytes]], Any]) -> None:
    """Call `write` on a temporary file beside `path`, and rename it there when all is on disk."""
    path = Path(path)
    if not path.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "No such folder", str(path.parent))
    descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    try:
        with os.fdopen(descriptor, "wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
