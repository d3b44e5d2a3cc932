"""Results that are not numbers: which rows, and a warning to whoever called."""

import warnings
from typing import Any

import numpy as np
from jaxtyping import Bool


class BreakdownWarning(UserWarning):
    """A result holds numbers that are not finite, or a filter has lost all its particles."""


def finite_rows(post: Any) -> Bool[np.ndarray, "*B T"] | np.bool_:
    """Rows whose estimates are finite, as far as they were kept; the result is known, not traced."""
    kept = [getattr(post, name) for name in ("mean", "std")]
    return np.logical_and.reduce([np.isfinite(np.asarray(a)).all(-1) for a in kept if a is not None] or [np.True_])


def warned(found: Any) -> Any:
    """A result, or a list of them, after a warning of the first that broke down: to whoever called the caller."""
    named = enumerate(found) if isinstance(found, list) else [(None, found)]
    if (text := next(filter(None, (post.breakdown(series) for series, post in named)), None)) is not None:
        warnings.warn(text, BreakdownWarning, stacklevel=3)
    return found


def of_series(bad: Bool[np.ndarray, "*B"] | np.bool_, series: int | None) -> str:
    """Names the first series that is bad, by its own number or by its place among others."""
    place = np.argwhere(bad)[0] if np.ndim(bad) else [] if series is None else [series]
    return f" of series {', '.join(map(str, place))}" if len(place) else ""
