"""Parameters spread over devices: each has some of them, with their rows of the factor.

An update of the factor works on all rows alike (`triangular`), so that devices need not talk in it. They do for the
points, which are columns: those evaluated together are gathered in passing, each device evaluating its part of them.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from jax.custom_batching import custom_vmap
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Float

AXIS = "parameters"


def mesh(devices: Sequence[Any] | None, L: int) -> Mesh | None:
    """Of these devices; nothing where none are named.

    Raises:
        ValueError: not a list of different devices, or a number of parameters that is not a multiple of theirs.
    """
    if devices is None:
        return None
    if not isinstance(devices, Sequence) or not devices or len(set(devices)) < len(devices):
        raise ValueError(f"devices must be a list of different devices, such as jax.devices(), got {devices!r}")
    if L % len(devices):
        raise ValueError(f"{L} parameters cannot be spread evenly over {len(devices)} devices: take a divisor of {L}")
    return Mesh(np.array(devices), (AXIS,))


def parts(over: Mesh | None) -> int:
    """Into how many the parameters are spread."""
    return 1 if over is None else over.size


def spread(tree: Any, over: Mesh | None, L: int) -> Any:
    """The same arrays, those whose last axis are the parameters spread over the devices."""
    if over is None:
        return tree

    def one(a: Array) -> Array:
        if not a.size:
            return a
        axes = [*(None,) * (a.ndim - 1), AXIS] if a.ndim and a.shape[-1] == L else []
        return jax.lax.with_sharding_constraint(a, NamedSharding(over, PartitionSpec(*axes)))

    return jax.tree.map(one, tree)


def gathered(over: Mesh | None) -> Callable[[Float[Array, " L"]], Float[Array, " L"]]:
    """A function that brings all parameters of a point to one device; of several points, some to each."""
    if over is None:
        return lambda w: w

    @custom_vmap
    def whole(w: Array) -> Array:
        return jax.lax.with_sharding_constraint(w, NamedSharding(over, PartitionSpec()))

    @whole.def_vmap
    def _(points: int, _: Any, w: Array) -> tuple[Array, bool]:
        rows = None if points % over.size else AXIS
        return jax.lax.with_sharding_constraint(w, NamedSharding(over, PartitionSpec(rows, None))), True

    @jax.custom_jvp
    def gather(w: Array) -> Array:
        return whole(w)

    @gather.defjvp
    def _(w: tuple[Array], step: tuple[Array]) -> tuple[Array, Array]:
        return whole(*w), step[0]

    return gather
