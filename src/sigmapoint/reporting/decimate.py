"""Fewer points for drawing: from every run of neighbours, the lowest and the highest.

A curve drawn from these looks like the curve from all points: no peak is lost (the min-max part of Steinarsson,
*Downsampling Time Series for Visual Representation*, 2013).
"""

import numpy as np
from jaxtyping import Float, Int

POINTS = 4000
"""Points drawn of one curve, at most."""
MOST_BREAKS = POINTS // 8
"""Breaks of one curve, at most."""


def extremes(
    low: Float[np.ndarray, "T"], high: Float[np.ndarray, "T"] | None = None, points: int = POINTS
) -> Int[np.ndarray, "P"]:
    """Rows that keep the minima of `low` and the maxima of `high` (the same curve where not given), ends included."""
    high = low if high is None else high
    T = low.size
    if points >= T:
        return np.arange(T)
    bounds = np.linspace(0, T, (points - 2) // 2 + 1).astype(int)
    width = int(np.diff(bounds).max())
    rows = np.minimum(bounds[:-1, None] + np.arange(width), bounds[1:, None] - 1)
    lowest = np.where(np.isfinite(low), low, np.inf)[rows].argmin(1)
    highest = np.where(np.isfinite(high), high, -np.inf)[rows].argmax(1)
    first = rows[:, 0]
    return np.unique(np.concatenate([[0], first + lowest, first + highest, [T - 1]]))


def with_breaks(
    breaks: Int[np.ndarray, "B"], low: Float[np.ndarray, "T"], high: Float[np.ndarray, "T"] | None = None
) -> tuple[Int[np.ndarray, "P"], Int[np.ndarray, "B"]]:
    """Rows as of `extremes`, with those on both sides of every break; and the breaks as positions among them.

    A curve with more than `MOST_BREAKS` fills its figure from edge to edge; it is drawn as one line, which does too.
    """
    if breaks.size > MOST_BREAKS:
        breaks = breaks[:0]
    rows = extremes(low, high, POINTS if low.size <= POINTS else POINTS - 2 * breaks.size)
    rows = np.unique(np.concatenate([rows, breaks - 1, breaks]))
    return rows, np.searchsorted(rows, breaks)


def compact(values: np.ndarray) -> np.ndarray:
    """In single precision where nobody can see the difference, else as it is."""
    if values.dtype.kind != "f" or not np.isfinite(values).any():
        return values
    spread = np.nanmax(values[np.isfinite(values)]) - np.nanmin(values[np.isfinite(values)])
    small = values.astype(np.float32)
    finite = np.isfinite(values)
    return small if np.abs(small - values)[finite].max() <= 1e-6 * spread else values
