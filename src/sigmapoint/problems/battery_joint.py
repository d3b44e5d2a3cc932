"""Capacity and series resistance of a cell beside its state of charge, on a run that the cell is not identified from.

Everything else is known from the runs at the two other temperatures: OCV curve, RC pairs, noise. The state "log
resistance" of `problems.battery`, which scales all three resistances, is switched off: the series resistance is an
unknown parameter here, and moves slowly as it does along the state of charge.

What can be compared: the capacity with the charge counted from full to empty, of the same run; the series resistance
with the jump of the voltage at a jump of the current, which needs no model (but has a little of the fast pair in it, a
sample being 0.5 to 1 s long).
"""

from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import Partial
from jaxtyping import Array, Float

from sigmapoint.data import TEMPERATURES, Log, load_leaf
from sigmapoint.model import StateSpaceModel
from sigmapoint.noise import Gaussian
from sigmapoint.problems import battery
from sigmapoint.problems.battery_identification import identify

JUMP = 15.0
"""[A] a change of current from one sample to the next that shows the series resistance"""


class Held(NamedTuple):
    """A run and a cell that was identified without it."""

    log: Log
    cell: battery.Cell
    u: dict[str, Any]
    counted: float
    """[Ah] from full to empty"""
    reference: Float[np.ndarray, "T"]
    """state of charge [1] by counting charge from full"""

    @property
    def y(self) -> Float[Array, "T 1"]:
        """Measured voltage [V]."""
        return jnp.asarray(self.log.voltage)[:, None]


class Unknown(NamedTuple):
    """What is estimated beside the states."""

    capacity: Any
    """[Ah]"""
    r0: Any
    """[Ω]"""


def held(temperature: int) -> Held:
    """The bundled run at a temperature [°C], and the cell as known from the other two.

    Raises:
        ValueError: a temperature that there is no run of.
    """
    log = load_leaf(temperature)
    cell = identify([load_leaf(t) for t in TEMPERATURES if t != temperature], temperature)
    cell = cell._replace(resistance_std=0.0, resistance_drift=0.0)
    counted = float(1 - battery.reference_soc(log, 1.0, cell.efficiency)[-1])
    reference = battery.reference_soc(log, counted, cell.efficiency)
    return Held(log, cell, jax.tree.map(jnp.asarray, battery.inputs(log)), counted, reference)


def model(run: Held, theta: Unknown, soc: Float[Array, ""], soc_std: float) -> StateSpaceModel:
    """The cell with this capacity and series resistance, for `sp.joint`.

    Args:
        run: from `held`.
        theta: capacity [Ah] and series resistance [Ω].
        soc: [1] first guess of the state of charge.
        soc_std: [1] its standard deviation.
    """
    told = battery.model(run.cell, battery.inputs(run.log), 0.5, soc_std)
    cell = run.cell._replace(
        capacity=theta.capacity, r0=theta.r0, knots=jnp.asarray(run.cell.knots), pieces=jnp.asarray(run.cell.pieces)
    )
    return replace(
        told,
        dynamics=Partial(battery.dynamics, cell),
        observation=Partial(battery.observation, cell),
        initial=Gaussian(told.initial.mean.at[0].set(soc), told.initial.cov),
    )


def jumps(log: Log) -> tuple[np.ndarray, np.ndarray]:
    """Rows where the current jumps between test steps, and the jump of the voltage over that of the current [Ω].

    Examples:
        >>> from sigmapoint.data import load_leaf
        >>> rows, resistance = jumps(load_leaf(25))
        >>> bool(0.0014 < np.median(resistance) < 0.0018)
        True
    """
    changed = (np.diff(log.step) != 0) & (np.abs(np.diff(log.current)) > JUMP)
    rows = np.flatnonzero(changed) + 1
    return rows, (log.voltage[rows] - log.voltage[rows - 1]) / (log.current[rows] - log.current[rows - 1])
