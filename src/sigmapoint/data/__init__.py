"""Bundled real data: the Nissan Leaf cell of Oak Ridge National Laboratory (``leaf/SOURCE.md``, MIT licence).

Each run: full charge (10 A to 4.2 V, then constant voltage), 1 h rest, then ten times {30 A discharge pulse of 30 s,
40 s rest, 22 A charge pulse of 10 s, 10 A discharge of 3 Ah, 1 h rest}, the last discharge down to 3.0 V.

A row is written at the *end* of its sampling interval: ``current[k]`` flowed during ``(time[k-1], time[k]]``.  At a
step change the old current therefore stops at ``time[k-1]``, not at ``time[k]`` (intervals last 0.1 to 60 s).
"""

import csv
import gzip
import io
from importlib.resources import files
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, Shaped

TEMPERATURES = (10, 25, 40)
"""Chamber temperatures of the bundled runs [°C]."""


class Log(NamedTuple):
    """One logged run of a cell; every array has one row per sample."""

    temperature: float
    """chamber temperature [°C]"""
    time: Float[np.ndarray, "T"]
    """time since the start of the log [s]"""
    current: Float[np.ndarray, "T"]
    """cell current [A], charge positive, discharge negative"""
    voltage: Float[np.ndarray, "T"]
    """terminal voltage [V], resolution 1 mV"""
    step: Int[np.ndarray, "T"]
    """number of the test step (4 = full charge, 6 = discharge pulse, 8 = charge pulse, 9 = 3 Ah discharge)"""
    mode: Shaped[np.ndarray, "T"]
    """REST, CHRG or DCHG"""


def load_leaf(temperature: int) -> Log:
    """Load one bundled run of the Nissan Leaf cell.

    Args:
        temperature: chamber temperature [°C], one of 10, 25, 40.

    Returns:
        The run as a `Log` of numpy arrays.

    Raises:
        ValueError: if there is no run at that temperature.

    Source: Wiggins, Allu & Wang (2019), doi 10.5281/zenodo.2580327.

    Examples:
        >>> load_leaf(25).voltage[0]
        np.float64(3.327)
    """
    if temperature not in TEMPERATURES:
        raise ValueError(f"temperature: no bundled run at {temperature!r} °C; choose one of {TEMPERATURES}")
    packed = files("sigmapoint.data").joinpath("leaf", f"hppc-{int(temperature)}C.csv.gz").read_bytes()
    rows = csv.reader(io.StringIO(gzip.decompress(packed).decode("ascii")))
    next(rows)
    time, current, voltage, step, mode = zip(*rows, strict=True)
    number = np.float64
    return Log(
        temperature=float(temperature),
        time=np.array(time, number),
        current=np.array(current, number),
        voltage=np.array(voltage, number),
        step=np.array(step, np.int64),
        mode=np.array(mode),
    )
