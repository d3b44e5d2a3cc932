"""Can an estimate be trusted? Consistency of a filter with itself, and with the truth where that is known.

Four questions: are innovations as large as the filter says (NIS, `sigmapoint.consistency`); are they white, unbiased,
Gaussian and unrelated to the inputs (`sigmapoint.whiteness`); are errors as large as it says, where the truth is known
(NEES, coverage); and what does all that mean (`sigmapoint.verdicts`).

Innovations of a consistent filter are white, so the band of the mean NIS holds; if they are correlated in time the mean
scatters more than its band says. Errors are *always* correlated in time: the band of the mean NEES is a guide.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from sigmapoint import verdicts
from sigmapoint.consistency import Consistency, Coverage, consistency, coverage, normalised
from sigmapoint.results import Posterior, field, host, input_columns
from sigmapoint.verdicts import Verdict
from sigmapoint.whiteness import COLUMNS, Element, examined


class Diagnosis(NamedTuple):
    """What `diagnose` found; `nees` and `coverage` only where the truth is known."""

    nis: Consistency
    elements: tuple[Element, ...]
    nees: Consistency | None
    coverage: tuple[Coverage, ...]
    lost: int
    """rows that were measured but have no finite innovation"""
    verdicts: tuple[Verdict, ...]


def errors(post: Posterior, truth: Any) -> Float[np.ndarray, "T n"]:
    """Truth minus estimate, in the model's `state_space`."""
    mean, truth = field(post, "mean"), host(truth).astype(float)
    if truth.shape != mean.shape:
        raise ValueError(f"truth must have the shape of the estimates, {mean.shape}, got {truth.shape}")
    difference = jax.vmap(post.labels.state_space.residual)
    return np.asarray(difference(jnp.asarray(truth, mean.dtype), jnp.asarray(mean)))


def diagnose(post: Posterior, truth: Any = None) -> Diagnosis:
    """Say in numbers and in words whether a result can be trusted.

    Args:
        post: result of `filter` or `smooth` for one series, with `innovation`, `innovation_cov` and `nis` kept.
        truth: true states (T, n) where they are known; then `mean`, `cov` and `std` must have been kept.

    Returns:
        NIS, tests of the innovations of each measured quantity, NEES and coverage, and `verdicts`: sentences with a
        severity, `good`, `warning` or `bad`.

    Raises:
        ValueError: a field was not kept; a batch of results; a truth of another shape.
        ImportError: scipy is not installed (`pip install sigmapoint[cli]`).

    Examples:
        >>> import jax, jax.numpy as jnp, sigmapoint as sp
        >>> from sigmapoint.diagnostics import diagnose
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> x, y = sp.simulate(model, 500, key=jax.random.key(0))
        >>> {verdict.severity for verdict in diagnose(sp.filter(model, y), truth=x).verdicts}
        {'good'}
    """
    innovation, nis = field(post, "innovation"), field(post, "nis")
    normal = normalised(innovation, field(post, "innovation_cov"))
    inputs = dict(list(input_columns(post.u, len(nis)).items())[:COLUMNS])
    names = post.labels.innovations(innovation.shape[1]).names
    elements = tuple(examined(name, z, inputs) for name, z in zip(names, normal.white.T))
    measured = np.isfinite(np.asarray(post.y)).any(1)
    lost = int((measured & ~(np.isfinite(innovation).any(1) & np.isfinite(nis))).sum())
    nees, covered = (None, ()) if truth is None else _against(post, truth)
    whole = consistency(nis, normal.degrees)
    return Diagnosis(whole, elements, nees, covered, lost, verdicts.of(whole, elements, nees, covered, lost))


def _against(post: Posterior, truth: Any) -> tuple[Consistency, tuple[Coverage, ...]]:
    error, std = errors(post, truth), field(post, "std")
    normal = normalised(error, field(post, "cov"))
    rows = zip(post.labels.directions(std.shape[1]).names, error.T, std.T)
    return consistency(normal.squared, normal.degrees), tuple(coverage(*row) for row in rows)
