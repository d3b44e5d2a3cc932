"""Arrays spread over several devices."""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array


def mesh(devices: Sequence[Any] | None, axis: str, size: int) -> Mesh | None:
    """Of these devices, to spread an axis of this name and size over; nothing where none are named.

    Raises:
        ValueError: not a list of different devices, or a size that is not a multiple of their number.
    """
    if devices is None:
        return None
    if not isinstance(devices, Sequence) or not devices or len(set(devices)) < len(devices):
        raise ValueError(f"devices must be a list of different devices, such as jax.devices(), got {devices!r}")
    if size % len(devices):
        raise ValueError(f"{size} {axis} cannot be spread evenly over {len(devices)} devices: take a divisor of {size}")
    return Mesh(np.array(devices), (axis,))


def placed(a: Array, over: Mesh, *axes: str | None) -> Array:
    """The same array, its axes spread over those of the devices that are named."""
    return jax.lax.with_sharding_constraint(a, NamedSharding(over, PartitionSpec(*axes)))
