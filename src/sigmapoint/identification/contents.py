"""What a page about an identified model shows: its parameters in their own units, and its noises."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from sigmapoint.contents import Contents, Curve, Panel, Row, Section
from sigmapoint.identification.estimates import Estimates, estimates
from sigmapoint.identification.unknowns import Unknowns, names_of
from sigmapoint.model import StateSpaceModel
from sigmapoint.results import Axis, Labels, Posterior, host
from sigmapoint.spaces import front

PARAMETERS, NOISES = "Parameters", "Noises"
MANY = 12
"""Elements of a noise, past which its correlations are not listed."""


def columns(tree: Any, *lead: int) -> Float[np.ndarray, "*T L"]:
    """The parameters in a pytree of them, with leading axes `lead`, one after the other as they are named."""
    leaves = [host(leaf) for leaf in jax.tree.leaves(tree) if eqx.is_inexact_array(leaf)]
    return np.concatenate([leaf.reshape(*lead, -1) for leaf in leaves], axis=-1)


def at_one_time(names: Sequence[str], found: Estimates) -> Section:
    """Parameters that stay, as a table."""
    return Section(PARAMETERS, tables={"": _rows(names, *map(columns, _parts(found)))})


def over_time(names: Sequence[str], found: Estimates) -> Section:
    """Parameters after each sample, and as a table those at the end."""
    T = jax.tree.leaves(eqx.filter(found.value, eqx.is_inexact_array))[0].shape[0]
    value, std, low, high = (columns(part, T) for part in _parts(found))
    panels = {name: Panel((Curve(value[:, i], low[:, i], high[:, i]),)) for i, name in enumerate(names)}
    text = "Line: the estimate after each sample, in the parameter's own unit. Band: the central 95 %."
    return Section(
        PARAMETERS, text, tables={"At the end": _rows(names, value[-1], std[-1], low[-1], high[-1])}, panels=panels
    )


def values(theta: Any) -> Section:
    """Parameters without error bars, as a table."""
    rows = zip(names_of(theta), columns(theta))
    return Section(PARAMETERS, tables={"": tuple({"parameter": name, "value": value} for name, value in rows)})


def separate(theta: Any, post: Posterior) -> Contents:
    """A result of `joint` as one of the states alone, and the parameters in their own units.

    Raises:
        ValueError: as `estimates`.
    """
    found, unknowns = estimates(theta, post), Unknowns.of(theta)
    own = slice(-unknowns.size)

    def of_states(a: Array | None, *axes: slice) -> Any:
        return None if a is None else a[(..., *axes)]

    labels = replace(
        post.labels,
        states=post.labels.states[own],
        state_units=post.labels.state_units[own],
        state_space=front(post.labels.state_space),
    )
    mean, cov, std = of_states(post.mean, own), of_states(post.cov, own, own), of_states(post.std, own)
    states = replace(post, mean=mean, cov=cov, std=std, labels=labels)
    return Contents({"": states}, (over_time(unknowns.names, found),))


def noises(model: StateSpaceModel) -> Section:
    """Deviations and correlations of the noises and of the initial belief, as tables."""
    n, m = model.initial.cov.shape[0], model.observation_noise.cov.shape[-1]
    labels = Labels.of(model, len(model.observation_names or model.observation_units or ()) or m)
    directions, measured = labels.directions(n), labels.innovations(m)
    q = model.process_noise.cov.shape[-1]
    moved = directions if q == n else Axis(tuple(f"w{i}" for i in range(q)), ("",) * q)
    tables = {
        "Process noise": _spread(moved, model.process_noise.cov),
        "Observation noise": _spread(measured, model.observation_noise.cov),
        "Initial belief": _spread(directions, model.initial.cov, model.initial.mean),
    }
    text = "As they are in the model that was found; what was not to be learned is as it was given."
    return Section(NOISES, text, tables={caption: rows for caption, rows in tables.items() if rows})


def _parts(found: Estimates) -> tuple[Any, ...]:
    return found.value, found.std, found.low, found.high


def _rows(names: Sequence[str], *parts: np.ndarray) -> tuple[Row, ...]:
    titles = ("value", "std", "95 % from", "to")
    return tuple({"parameter": name, **dict(zip(titles, row))} for name, row in zip(names, np.stack(parts, -1)))


def _spread(axis: Axis, covariance: Any, mean: Any = None) -> tuple[Row, ...]:
    """One row an element; none for a covariance that changes with time."""
    if covariance.ndim == 3:
        return ()
    cov = host(covariance).astype(float)
    variance = np.diagonal(cov)
    std = np.sqrt(variance)
    units = {"unit": axis.units} if any(axis.units) else {}
    means = {} if mean is None or len(mean) != len(std) else {"mean": host(mean)}
    listed: dict[str, Any] = {"": axis.names, **units, **means, "std": std, "variance": variance}
    if np.count_nonzero(cov - np.diag(variance)) and len(std) <= MANY:
        product = np.outer(std, std)
        correlation = np.where(product > 0, cov / np.where(product > 0, product, 1.0), 0.0)
        listed |= {f"correlation with {name}": row for name, row in zip(axis.names, correlation)}
    return tuple(dict(zip(listed, row)) for row in zip(*listed.values()))
