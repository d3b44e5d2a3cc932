"""What the page draws of each method: its fields as NumPy arrays, its diagnosis, its colour."""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from sigmapoint.checks import data_checks
from sigmapoint.curves import principal
from sigmapoint.diagnosis.accuracy import Coverage, errors
from sigmapoint.diagnosis.consistency import normalised
from sigmapoint.diagnosis.diagnostics import Diagnosis, diagnose
from sigmapoint.reporting.traces import Style
from sigmapoint.results import Axis, Labels, Posterior, host

ALIKE = 1e-9
"""Relative differences that are round-off."""


class Run(NamedTuple):
    """One method; what was not kept, or is not known, is None."""

    name: str
    style: Style
    mean: Float[np.ndarray, "T d"] | None
    std: Float[np.ndarray, "T n"] | None
    error: Float[np.ndarray, "T n"] | None
    coverage: tuple[Coverage, ...]
    """of each element of the error"""
    innovation: Float[np.ndarray, "T m"] | None
    predicted: Float[np.ndarray, "T e"] | None
    """measurement that was expected"""
    spread: Float[np.ndarray, "T m"] | None
    """standard deviation of the predicted measurement"""
    nis: Float[np.ndarray, "T"] | None
    degrees: Int[np.ndarray, "T"] | None
    diagnosis: Diagnosis | None
    log_likelihood: float


class Runs(NamedTuple):
    """All methods over the same series."""

    each: list[Run]
    labels: Labels
    y: Float[np.ndarray, "T e"]
    x: np.ndarray
    """instants (T,)"""
    axis: str
    """what those are"""
    truth: Float[np.ndarray, "T d"] | None

    @property
    def repeated(self) -> dict[str, str]:
        """Methods with the innovations of an earlier one, and which: those of a smoother are its filter's."""
        found: dict[str, str] = {}
        for i, run in enumerate(self.each):
            first = next((earlier for earlier in self.each[:i] if _same_innovations(earlier, run)), None)
            if first is not None:
                found[run.name] = first.name
        return found

    @property
    def distinct(self) -> "Runs":
        """Without those whose innovations are there already."""
        return self._replace(each=[run for run in self.each if run.name not in self.repeated])

    @property
    def errors(self) -> Axis:
        """The elements of an error; none where no method has one."""
        return self.labels.directions(_width(run.error for run in self.each))

    @property
    def innovations(self) -> Axis:
        """The elements of an innovation; none where no method kept it."""
        return self.labels.innovations(_width(run.innovation for run in self.each))


def runs_of(posts: Mapping[str, Posterior], x: np.ndarray, axis: str, truth: Any) -> Runs:
    """Everything the figures need.

    Raises:
        ValueError: results of different series; a truth of another shape.
    """
    first = next(iter(posts.values()))
    labels = first.labels
    for name, post in posts.items():
        if post.y.shape != first.y.shape or post.labels != first.labels:
            raise ValueError(f"result {name!r} is of another series or model than the first; make one report for each")
    true = None if truth is None else data_checks.truth(truth, (first.y.shape[0], len(labels.states)))
    each = [_run(name, post, true, Style.of(i, len(posts))) for i, (name, post) in enumerate(posts.items())]
    shown = None if true is None else principal(labels.state_space, true)
    return Runs(each, labels, principal(labels.observation_space, host(first.y)), x, axis, shown)


def _run(name: str, post: Posterior, truth: np.ndarray | None, style: Style) -> Run:
    S, innovation = post.innovation_cov, post.innovation
    checkable = S is not None and innovation is not None and post.nis is not None
    judged = truth is not None and post.mean is not None and post.std is not None
    found = errors(post, truth) if judged else None
    truth_too = truth if judged and post.cov is not None else None
    return Run(
        name=name,
        style=style,
        mean=_optional(post.mean),
        std=_optional(post.std),
        error=None if found is None else found.value,
        coverage=() if found is None else found.each(),
        innovation=_optional(innovation),
        predicted=None if innovation is None else _predicted(post),
        spread=None if S is None else np.sqrt(np.maximum(np.einsum("tii->ti", host(S)), 0)),
        nis=_optional(post.nis),
        degrees=normalised(host(innovation), host(S)).degrees if checkable else None,
        diagnosis=diagnose(post, truth_too) if checkable else None,
        log_likelihood=float(post.log_likelihood),
    )


def _same_innovations(a: Run, b: Run) -> bool:
    """Whether one looks back from the other: two methods that agree have the same states, too."""
    if a.mean is not None and b.mean is not None and _same(a.mean, b.mean):
        return False
    pairs = ((a.innovation, b.innovation), (a.spread, b.spread), (a.nis, b.nis))
    return all(x is not None and y is not None and _same(x, y) for x, y in pairs)


def _same(x: np.ndarray, y: np.ndarray) -> bool:
    """But for round-off: two programs may add up in another order."""
    return x.shape == y.shape and np.allclose(
        x, y, rtol=ALIKE, atol=ALIKE * np.nanmax(np.abs(x), initial=0.0), equal_nan=True
    )


def _predicted(post: Posterior) -> Float[np.ndarray, "T e"]:
    """The innovation taken back from the measurement."""
    return host(jax.vmap(post.labels.observation_space.retract)(jnp.asarray(post.y), -jnp.asarray(post.innovation)))


def _width(fields: Iterable[np.ndarray | None]) -> int:
    return next((field.shape[1] for field in fields if field is not None), 0)


def _optional(value: Any) -> np.ndarray | None:
    return None if value is None else host(value)
