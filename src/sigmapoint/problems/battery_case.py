"""The run that is estimated: a cell at 25 °C, identified from its runs at 10 and 40 °C, started 20 points wrong."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint.data import Log, load_leaf
from sigmapoint.model import StateSpaceModel
from sigmapoint.problems import battery

TEMPERATURE, OTHERS = 25, (10, 40)
"""[°C] of the run, and of those that the cell is identified from."""
WRONG_BY = 0.2
"""Error of the first guess of the state of charge [1]."""


class Case(NamedTuple):
    """A run to estimate, with a model identified from other runs."""

    log: Log
    cell: battery.Cell
    u: dict[str, Any]
    reference: Float[np.ndarray, "T"]
    """state of charge [1] by counting charge from full"""
    model: StateSpaceModel

    @property
    def y(self) -> Float[Array, "T 1"]:
        """Measured voltage [V]."""
        return jnp.asarray(self.log.voltage)[:, None]

    @property
    def truth(self) -> Float[np.ndarray, "T n"]:
        """True states: the counted charge; the others are not known."""
        truth = np.full((self.reference.size, self.model.initial.mean.size), np.nan)
        truth[:, 0] = self.reference
        return truth


def leaf() -> Case:
    """The case of the bundled Nissan Leaf cell.

    Examples:
        >>> case = leaf()
        >>> case.y.shape, case.model.state_names[0]
        ((13248, 1), 'soc')
    """
    from sigmapoint.problems.battery_identification import identify  # the splines of scipy take a second to import

    log, cell = load_leaf(TEMPERATURE), identify([load_leaf(t) for t in OTHERS], TEMPERATURE)
    u, reference = battery.inputs(log), battery.reference_soc(log, cell.capacity, cell.efficiency)
    model = battery.model(cell, u, soc=float(reference[0]) + WRONG_BY)
    return Case(log, cell, jax.tree.map(jnp.asarray, u), reference, model)
