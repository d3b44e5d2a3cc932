"""Can an estimate be trusted? Consistency of a filter with itself, and with the truth where that is known.

Four questions: are innovations as large as the filter says (NIS, `consistency`); are they white, unbiased, Gaussian and
unrelated to the inputs (`whiteness`); are errors as large as it says, where the truth is known (NEES, coverage); and
what does all that mean (`verdicts`).

Innovations of a consistent filter are white, so the band of the mean NIS holds; if they are correlated in time the mean
scatters more than its band says. Errors are *always* correlated in time: the band of the mean NEES counts
as many rows as are independent, by their own correlations.
"""

from textwrap import fill
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from sigmapoint import checks
from sigmapoint.breakdown import finite_rows
from sigmapoint.diagnosis import verdicts
from sigmapoint.diagnosis.accuracy import Coverage, chance, errors, relative_to
from sigmapoint.diagnosis.consistency import Consistency, consistency, independent_rows, normalised
from sigmapoint.diagnosis.verdict import Verdict, gravest_first
from sigmapoint.diagnosis.whiteness import COLUMNS, Element, examined
from sigmapoint.results import Posterior, field, host, input_columns, measured_rows
from sigmapoint.spaces import Euclidean, folded

BAND = 2.0
"""Standard deviations on both sides of an estimate that figures show, and that sigma points are about as far out as."""
WIDTH = 120
"""Characters in a line of what is printed."""


class Diagnosis(NamedTuple):
    """What `diagnose` found; `nees` and `coverage` only where the truth is known."""

    nis: Consistency
    elements: tuple[Element, ...]
    nees: Consistency | None
    coverage: tuple[Coverage, ...]
    lost: int
    """rows whose estimate is not finite, or that were measured and have no finite innovation"""
    wide: dict[str, float]
    """states whose ±2σ band goes all the way round, as of an angle, and their largest standard deviation"""
    few: float
    """share of the rows in which fewer than ten particles count, of a particle filter"""
    verdicts: tuple[Verdict, ...]

    def __str__(self) -> str:
        """The verdicts, the gravest first; the numbers are in the fields."""
        return "\n".join(
            fill(v.text, WIDTH, initial_indent=f"{v.severity:<9}", subsequent_indent=9 * " ")
            for v in gravest_first(self.verdicts)
        )


def diagnose(post: Posterior, truth: Any = None) -> Diagnosis:
    """Say in numbers and in words whether a result can be trusted.

    Args:
        post: result of `filter` or `smooth` for one series, with `innovation`, `innovation_cov` and `nis` kept.
        truth: true states (T, n) where they are known; then `mean`, `cov` and `std` must have been kept.

    Returns:
        NIS, tests of the innovations of each measured quantity, NEES and coverage, and `verdicts`: sentences with a
        severity, `good`, `warning` or `bad`. `print` shows these alone.

    Raises:
        ValueError: a field was not kept; a batch of results; a truth of another shape.
        ImportError: scipy is not installed (`pip install sigmapoint[cli]`).

    Examples:
        >>> import jax, jax.numpy as jnp, sigmapoint as sp
        >>> from sigmapoint.diagnosis.diagnostics import diagnose
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> x, y = sp.simulate(model, 500, key=jax.random.key(0))
        >>> found = diagnose(sp.filter(model, y), truth=x)
        >>> {verdict.severity for verdict in found.verdicts}
        {'good'}
        >>> print(str(found).splitlines()[0])
        good     The error bars fit the innovations: mean NIS ... per measured element, expected 0.88 to 1.13; ...
    """
    checks.instance("post", post, Posterior, "a result of sp.filter or sp.smooth, as the `.post` of one of sp.dual")
    innovation, nis = field(post, "innovation"), field(post, "nis")
    normal = normalised(innovation, field(post, "innovation_cov"))
    inputs = dict(list(input_columns(post.u, len(nis)).items())[:COLUMNS])
    names = post.labels.innovations(innovation.shape[1]).names
    elements = tuple(examined(name, z, inputs) for name, z in zip(names, normal.white.T))
    measured = measured_rows(field(post, "y"), innovation.shape[1])
    lost = int((measured & ~(np.isfinite(innovation).any(1) & np.isfinite(nis)) | ~finite_rows(post)).sum())
    nees, covered, by_chance = (None, (), ()) if truth is None else _against(post, truth)
    whole = consistency(nis, normal.degrees)
    wide = _wide(post)
    few = _few(post)
    said = verdicts.of(whole, elements, nees, covered, by_chance, lost, wide, few)
    return Diagnosis(whole, elements, nees, covered, lost, wide, few, said)


def _few(post: Posterior) -> float:
    ess = getattr(post, "ess", None)
    return 0.0 if ess is None else float(np.mean(host(ess) < verdicts.PARTICLES))


def _wide(post: Posterior) -> dict[str, float]:
    """Looked for where each element is widest; nothing where `mean` or `std` was not kept."""
    space = post.labels.state_space
    if post.mean is None or post.std is None or isinstance(space, Euclidean):
        return {}
    mean, std = field(post, "mean"), field(post, "std")
    rows = np.where(np.isfinite(std), std, 0.0).argmax(0)
    widest = std[rows, np.arange(rows.size)]
    around = folded(space, jnp.asarray(mean[rows]), jnp.asarray(widest), BAND)
    names = post.labels.directions(rows.size).names
    return {name: float(s) for name, s, all_round in zip(names, widest, around) if all_round and np.isfinite(s)}


def _against(post: Posterior, truth: Any) -> tuple[Consistency, tuple[Coverage, ...], tuple[float, ...]]:
    """NEES; coverage of each state, and how probable less or larger errors are."""
    found = errors(post, truth)
    normal = normalised(found.value, field(post, "cov"))
    nees = consistency(normal.squared, normal.degrees, independent_rows(normal.white))
    covered, alone = found.each(), np.where(found.known, relative_to(found.value, found.std), np.nan)
    return nees, covered, tuple(chance(c, independent_rows(z[:, None])) for c, z in zip(covered, alone.T))
