"""Parameters spread over devices: each has some of them, with their rows of the factor.

An update of the factor works on all rows alike (`triangular`), so that devices need not talk in it. They do for the
points, which are columns: those evaluated together are gathered in passing, each device evaluating its part of them.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
from jax.custom_batching import custom_vmap
from jax.sharding import Mesh
from jaxtyping import Array, Float

from sigmapoint.devices import mesh as of_devices
from sigmapoint.devices import placed

AXIS = "parameters"


def mesh(devices: Sequence[Any] | None, L: int) -> Mesh | None:
    """Of these devices; see `devices.mesh`."""
    return of_devices(devices, AXIS, L)


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
        return placed(a, over, *axes)

    return jax.tree.map(one, tree)


def gathered(over: Mesh | None) -> Callable[[Float[Array, " L"]], Float[Array, " L"]]:
    """A function that brings all parameters of a point to one device; of several points, some to each."""
    if over is None:
        return lambda w: w

    @custom_vmap
    def whole(w: Array) -> Array:
        return placed(w, over)

    @whole.def_vmap
    def _(points: int, _: Any, w: Array) -> tuple[Array, bool]:
        rows = None if points % over.size else AXIS
        return placed(w, over, rows, None), True

    @jax.custom_jvp
    def gather(w: Array) -> Array:
        return whole(w)

    @gather.defjvp
    def _(w: tuple[Array], step: tuple[Array]) -> tuple[Array, Array]:
        return whole(*w), step[0]

    return gather
