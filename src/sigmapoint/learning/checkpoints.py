"""Checkpoints of training: written whole or not at all, and taken up by the same training only."""

import hashlib
from pathlib import Path
from typing import Any, TypeVar

import equinox as eqx
import jax
import numpy as np

from sigmapoint.storage import load, save

Tree = TypeVar("Tree")


def fingerprint(settings: Any, arrays: Any) -> np.ndarray:
    """Of settings, by how they are printed, and of all numbers in a pytree; functions in it are not looked at."""
    hashed = hashlib.sha256(repr(settings).encode())
    for where, leaf in jax.tree_util.tree_leaves_with_path(arrays):
        hashed.update(jax.tree_util.keystr(where).encode())
        if eqx.is_array_like(leaf):
            numbers = np.ascontiguousarray(leaf)
            hashed.update(f"{numbers.dtype}{numbers.shape}".encode() + numbers.tobytes())
    return np.frombuffer(hashed.digest(), np.uint8)


def store(path: Path, identity: np.ndarray, at: Any) -> None:
    """Save where training is."""
    save(path, (identity, at))


def resumed(path: Path, identity: np.ndarray, at: Tree) -> Tree:
    """Where training was, or `at` if the file does not exist.

    Raises:
        ValueError: a file of another training.
    """
    if not path.exists():
        return at
    try:
        with jax.enable_x64(True):  # counts and sums are of 64 bits in any case
            found, position = load(path, like=(identity, at))
    except ValueError as error:
        raise ValueError(
            f"checkpoint {path} is not of this training (parameters, epochs and method must be the same): {error}"
        ) from error
    if (np.asarray(found) != identity).any():
        raise ValueError(
            f"checkpoint {path} is of a training with other data or settings: delete it, or choose another file"
        )
    # Counts are NumPy's, as they were.
    return jax.tree.map(lambda was, now: np.asarray(now) if isinstance(was, np.ndarray) else now, at, position)
