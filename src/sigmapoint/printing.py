"""A result in a few lines, for `print`."""

import math
from collections.abc import Sequence

import numpy as np

from sigmapoint.diagnosis.consistency import surprise
from sigmapoint.results import Posterior, field

SHOWN = 6
"""States named, at most."""


def as_lines(post: Posterior) -> str:
    """What was estimated from how much, how well measurements were expected, and the last estimate of each state.

    Args:
        post: the result of one series, with `mean`, `std`, `innovation` and `nis` kept.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)), state_names=("level",))
        >>> print(as_lines(sp.filter(model, jnp.ones((5, 1)))))
        5 samples, 1 state, 1 measured quantity
        log-likelihood                 -7.148
        mean NIS per measured element  0.1236 (1 expected)
        last estimate
          level  0.99 ± 0.79
    """
    labels, mean, std = post.labels, field(post, "mean"), field(post, "std")
    found = surprise(field(post, "innovation"), field(post, "nis"))
    nis = f"{found.per_element:.4g} (1 expected)" if found.measured_elements else "nothing was measured"
    spread = std[-1] if std.shape == mean.shape else np.full(mean.shape[1], np.nan)
    width = max(map(len, labels.states[:SHOWN]))
    units = ("" if unit == "1" else unit for unit in labels.state_units)
    states = zip(labels.states, mean[-1], spread, units)
    named = [f"  {name:{width}}  {estimate(m, s)} {unit}".rstrip() for name, m, s, unit in states]
    more = [f"  and {len(named) - SHOWN} more"] if len(named) > SHOWN else []
    counts = (
        counted(len(mean), "sample"),
        counted(len(labels.states), "state"),
        counted(len(labels.observations), "measured quantity", "measured quantities"),
    )
    return "\n".join(
        [
            ", ".join(counts),
            f"log-likelihood                 {float(post.log_likelihood):.4g}",
            f"mean NIS per measured element  {nis}",
            "last estimate",
            *named[:SHOWN],
            *more,
        ]
    )


def estimate(mean: float, std: float) -> str:
    """`0.123 ± 0.045`: as many decimals as two digits of the standard deviation have, where those are few."""
    if math.isnan(std):
        return f"{mean:.4g}"
    if not (1e-6 <= std < 1e6 and abs(mean) < 1e9):
        return f"{mean:.4g} ± {std:.2g}"
    decimals = max(0, 1 - math.floor(math.log10(std)))
    return f"{mean:.{decimals}f} ± {std:.{decimals}f}"


def aligned(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Lines in which the cells of a column begin below each other."""
    widths = [max(map(len, column)) for column in zip(*rows)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip() for row in rows]


def counted(count: int, one: str, many: str = "") -> str:
    """`1 state`, `13 248 samples`."""
    return f"{count:,}".replace(",", "\u202f") + f" {one if count == 1 else many or one + 's'}"
