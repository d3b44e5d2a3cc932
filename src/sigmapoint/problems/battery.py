"""State of charge of a lithium-ion cell: two RC pairs, an uncertain OCV table and an uncertain resistance.

With i the current [A] (charge positive) and Δs the change of charge during a step,

    s⁺ = s + Δs                     Δs = held · dt / (3600 · capacity), times the charge efficiency when charging
    v⁺ = a v + (1 - a) r eᵖ held    a = exp(-dt / τ), exact for a constant current; a fast and a slow pair
    b⁺ = exp(-|Δs| / ℓ) b           error of the OCV table, as a shift along the SOC axis
    ρ⁺ = ρ                          logarithm of the scale of all three resistances: a slow random walk
    y  = OCV(s + b) + r0 eᵖ i + v_fast + v_slow

The noise has to say that model error is *correlated*: a wrong table stays wrong as long as the cell stays at one SOC.
So b is Gauss-Markov in SOC, not in time, and the RC pairs carry Gauss-Markov noise with their own time constants.
Writing the table error along SOC (rather than in volts) also keeps the extended filter consistent: ∂y/∂s = ∂y/∂b
wherever it linearises, so no false information about s - b enters. All noise scales with the step, Q[k] = σ²(1 - a²).

The observation noise starts at 0.1 V and decays within minutes: the OCV curve bends sharply below 10 % SOC, and a first
update trusted to 0.3 mV but linearised 20 points away ruins the extended filter. Sigma-point rules do not need it.

Equivalent circuit: Plett, *Battery Management Systems I* (2015), chapter 2. Sigma-point filter for it: Plett, J. Power
Sources 161 (2006) 1369. Parameters: `sigmapoint.problems.battery_identification`.
"""

from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import sigmapoint as sp
from sigmapoint.data import Log

STATES = ("soc", "fast", "slow", "table", "log_resistance")
UNITS = ("1", "V", "V", "1", "1")
FULL_CHARGE = 4
"""Step of the test that charges the cell to 4.2 V and holds it until the current has fallen to 0.5 A."""
SOFT_START = 0.1, 120.0
"""Extra observation noise at the start: standard deviation [V] and the time constant of its decay [s]."""

Number = TypeVar("Number", Float[np.ndarray, "*T"], Float[Array, "*T"])


class Cell(NamedTuple):
    """Parameters of a cell at one temperature."""

    capacity: float
    """[Ah] from full (end of the constant-voltage charge) to 3.0 V under 10 A: SOC 1 to SOC 0"""
    efficiency: float
    """charge taken out per charge put in (includes the gain error of the current sensor)"""
    knots: Float[np.ndarray, "K"]
    """[1] SOC where the cubic pieces of the OCV curve join"""
    pieces: Float[np.ndarray, "4 K-1"]
    """[V] coefficients of each piece in powers 3, 2, 1, 0 of the distance to its left knot"""
    r0: float
    """[Ω] series resistance"""
    r_fast: float
    """[Ω] resistance of the fast RC pair"""
    r_slow: float
    """[Ω] resistance of the slow RC pair"""
    tau_fast: float
    """[s] time constant of the fast RC pair"""
    tau_slow: float
    """[s] time constant of the slow RC pair"""
    table_std: float
    """[1] standard deviation of the error of the OCV curve along the SOC axis"""
    table_length: float
    """[1] change of SOC over which that error is forgotten"""
    fast_std: float
    """[V] stationary standard deviation of the error of the fast pair"""
    slow_std: float
    """[V] stationary standard deviation of the error of the slow pair"""
    gain_std: float
    """[1] random walk of the counted charge, per square root of unit SOC moved"""
    voltage_std: float = 1e-3 / 12**0.5
    """[V] white noise: rounding to 1 mV"""
    resistance_std: float = 0.2
    """[1] standard deviation of the initial log_resistance"""
    resistance_drift: float = 0.05
    """[1] random walk of log_resistance, per square root of an hour"""


def soc_change(held: Number, dt: Number, capacity: float, efficiency: float) -> Number:
    """Return the change of SOC [1] when ``held`` [A] flows for ``dt`` [s]; charging counts ``efficiency`` times."""
    charging, discharging = (held + abs(held)) / 2, (held - abs(held)) / 2
    return (efficiency * charging + discharging) * dt / (3600 * capacity)


def inputs(log: Log) -> dict[str, Float[np.ndarray, "T"]]:
    """Return the inputs u[k] of a logged run.

    A row is logged at the end of its interval, so what flows from k to k+1 is read off row k+1: the mean of both ends
    inside a test step, the newer current across a change of step (the rule that reproduces the tester's own counter).

    Args:
        log: the run.

    Returns:
        ``current`` [A] at the sample, ``held`` [A] and ``dt`` [s]: the mean current and length of the step that follows
        the sample (zero after the last one).
    """
    i = log.current
    same_step = log.step[1:] == log.step[:-1]
    held = np.where(same_step, (i[1:] + i[:-1]) / 2, i[1:])
    return {"current": i, "held": np.append(held, 0.0), "dt": np.append(np.diff(log.time), 0.0)}


def anchor(log: Log) -> int:
    """Return the row where the full charge ends (SOC = 1): 4.2 V, current down to 0.5 A."""
    return int(np.flatnonzero(log.step == FULL_CHARGE)[-1])


def reference_soc(log: Log, capacity: float, efficiency: float = 1.0) -> Float[np.ndarray, "T"]:
    """Count charge with the real time steps, from SOC = 1 at the end of the full charge, backwards and forwards.

    Args:
        log: the run.
        capacity: [Ah] between SOC 1 and SOC 0.
        efficiency: [1] weight of the charging current.

    Returns:
        SOC [1] at every sample.
    """
    u = inputs(log)
    moved = np.cumsum(soc_change(u["held"], u["dt"], capacity, efficiency))
    soc = np.concatenate([[0.0], moved[:-1]])
    return 1 + (soc - soc[anchor(log)])


def ocv(cell: Cell, soc: Float[Array, ""]) -> Float[Array, ""]:
    """Return the open-circuit voltage [V] at ``soc`` [1]: increasing, smooth, a straight line beyond the table."""
    knots, pieces = jnp.asarray(cell.knots, soc.dtype), jnp.asarray(cell.pieces, soc.dtype)
    inside = jnp.clip(soc, knots[0], knots[-1])
    j = jnp.clip(jnp.searchsorted(knots, inside, side="right") - 1, 0, knots.size - 2)
    d, (c3, c2, c1, c0) = inside - knots[j], pieces[:, j]
    value, slope = ((c3 * d + c2) * d + c1) * d + c0, (3 * c3 * d + 2 * c2) * d + c1
    return value + slope * (soc - inside)


def dynamics(cell: Cell, x: Float[Array, "5"], u: dict[str, Float[Array, ""]]) -> Float[Array, "5"]:
    """Return the state after the step described by ``u`` (see the module)."""
    soc, fast, slow, table, log_resistance = x
    moved = soc_change(u["held"], u["dt"], cell.capacity, cell.efficiency)
    drive = jnp.exp(log_resistance) * u["held"]
    a, b = jnp.exp(-u["dt"] / cell.tau_fast), jnp.exp(-u["dt"] / cell.tau_slow)
    return jnp.stack(
        [
            soc + moved,
            a * fast + (1 - a) * cell.r_fast * drive,
            b * slow + (1 - b) * cell.r_slow * drive,
            jnp.exp(-jnp.abs(moved) / cell.table_length) * table,
            log_resistance,
        ]
    )


def observation(cell: Cell, x: Float[Array, "5"], u: dict[str, Float[Array, ""]]) -> Float[Array, "1"]:
    """Return the terminal voltage [V]."""
    soc, fast, slow, table, log_resistance = x
    voltage = ocv(cell, soc + table) + cell.r0 * jnp.exp(log_resistance) * u["current"] + fast + slow
    return voltage[None]


def process_noise(cell: Cell, u: dict[str, Float[np.ndarray, "T"]]) -> Float[np.ndarray, "T 5 5"]:
    """Return Q[k] of the step after each sample, from its length and the charge it moves."""
    dt, moved = u["dt"], abs(soc_change(u["held"], u["dt"], cell.capacity, cell.efficiency))
    variances = [
        cell.gain_std**2 * moved,
        cell.fast_std**2 * -np.expm1(-2 * dt / cell.tau_fast),
        cell.slow_std**2 * -np.expm1(-2 * dt / cell.tau_slow),
        cell.table_std**2 * -np.expm1(-2 * moved / cell.table_length),
        cell.resistance_drift**2 * dt / 3600,
    ]
    return np.stack(variances, axis=-1)[:, :, None] * np.eye(5)


def observation_noise(cell: Cell, u: dict[str, Float[np.ndarray, "T"]]) -> Float[np.ndarray, "T 1 1"]:
    """Return R[k] [V²]: rounding, and the soft start (see the module)."""
    elapsed = np.concatenate([[0.0], np.cumsum(u["dt"])[:-1]])
    std, decay = SOFT_START
    return (cell.voltage_std**2 + (std * np.exp(-elapsed / decay)) ** 2)[:, None, None]


def model(cell: Cell, u: dict[str, Float[np.ndarray, "T"]], soc: float, soc_std: float = 0.2) -> sp.StateSpaceModel:
    """Build the state-space model of a cell for one run.

    Args:
        cell: parameters at the temperature of the run.
        u: inputs of the run, from `inputs`.
        soc: [1] first guess of the state of charge.
        soc_std: [1] its standard deviation.

    Returns:
        A model with the states ``soc`` [1], ``fast`` [V], ``slow`` [V], ``table`` [1], ``log_resistance`` [1], and the
        terminal voltage [V] as the one observation.

    Examples:
        >>> from sigmapoint.data import load_leaf
        >>> from sigmapoint.problems.battery_identification import identify
        >>> cell = identify([load_leaf(10), load_leaf(40)], temperature=25)
        >>> log = load_leaf(25)
        >>> u = inputs(log)
        >>> post = sp.filter(model(cell, u, soc=0.5), log.voltage[:, None], u, method=sp.srcdkf())
    """
    cell = cell._replace(knots=jnp.asarray(cell.knots), pieces=jnp.asarray(cell.pieces))
    std = np.array([soc_std, cell.fast_std, cell.slow_std, cell.table_std, cell.resistance_std])
    return sp.StateSpaceModel(
        dynamics=jax.tree_util.Partial(dynamics, cell),
        observation=jax.tree_util.Partial(observation, cell),
        process_noise=jnp.asarray(process_noise(cell, u)),
        observation_noise=jnp.asarray(observation_noise(cell, u)),
        initial=sp.Gaussian(jnp.array([soc, 0.0, 0.0, 0.0, 0.0]), jnp.diag(jnp.asarray(std**2))),
        state_names=STATES,
        state_units=UNITS,
        observation_names=("voltage",),
        observation_units=("V",),
    )
