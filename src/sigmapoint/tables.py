"""Results as labelled tables: `xarray.Dataset` and `pandas.DataFrame`, with the units of every column."""

from datetime import UTC, datetime
from functools import reduce
from typing import Any

import numpy as np

from sigmapoint import checks
from sigmapoint.results import Axis, Posterior, check_single, host, input_columns, measured_rows


def to_xarray(post: Posterior, time: Any = None) -> Any:
    """The result of one series as an `xarray.Dataset`.

    Args:
        post: the result.
        time: instants (T,), numbers or dates; 0, 1, 2, … where not given.

    Returns:
        `mean`, `std` (time, state), `cov` (time, state, state2), `innovation` (time, observation), `innovation_cov`,
        `nis` (time), `y`, and `u` (time, input) where inputs are numeric columns; of particle filters `ess` (time),
        `particles` (time, particle, state), `log_weights` and `ancestors`; of Gaussian sums `mixture.log_weights`
        (time, component), `mixture.mean`, `mixture.cov`; what was not kept is left out.
        Coordinates `state_unit` and `observation_unit`; attribute `log_likelihood`. On a manifold with fewer dimensions
        than elements, errors are along `tangent` in place of `state`, and `observation_tangent` of `observation`.

    Raises:
        ValueError: `time` of another length; a batch of results.
        ImportError: xarray is not installed.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)), state_names=("level",))
        >>> data = to_xarray(sp.filter(model, jnp.ones((5, 1))))
        >>> dict(data["cov"].sizes)
        {'time': 5, 'state': 1, 'state2': 1}
    """
    xr = checks.extra("xarray", "to_xarray")
    check_single(post)
    T, labels = post.y.shape[0], post.labels
    errors, surprises = _errors(post), _innovations(post)
    delta = "state" if errors.names == labels.states else "tangent"
    sensed = "observation" if surprises.names == labels.observations else "observation_tangent"
    dims = {
        "mean": ("time", "state"),
        "std": ("time", delta),
        "cov": ("time", delta, f"{delta}2"),
        "innovation": ("time", sensed),
        "innovation_cov": ("time", sensed, f"{sensed}2"),
        "nis": ("time",),
        **post.AXES,
    }
    kept = {name: reduce(lambda of, part: getattr(of, part, None), name.split("."), post) for name in dims}
    fields = {name: (dims[name], host(values)) for name, values in kept.items() if values is not None}
    if post.nis is not None:
        fields["nis"] = (("time",), _nis(post))
    fields["y"] = (("time", "observation"), host(post.y))
    inputs = input_columns(post.u, T)
    if inputs:
        fields["u"] = (("time", "input"), np.stack(list(inputs.values()), 1))
    coords: dict[str, Any] = {
        "time": instants(time, T),
        "state": list(labels.states),
        "observation": list(labels.observations),
        delta: list(errors.names),
        f"{delta}2": list(errors.names),
        sensed: list(surprises.names),
        f"{sensed}2": list(surprises.names),
        "state_unit": ("state", list(labels.state_units)),
        "observation_unit": ("observation", list(labels.observation_units)),
    } | ({"input": list(inputs)} if inputs else {})
    data = xr.Dataset(fields, coords, {"log_likelihood": float(post.log_likelihood)})
    units = {
        "mean": labels.state_units,
        "std": errors.units,
        "innovation": surprises.units,
        "y": labels.observation_units,
        "particles": labels.state_units,
        "mixture.mean": labels.state_units,
    }
    for name in units.keys() & set(data):
        data[name].attrs["units"] = list(units[name])
    return data


def to_frame(post: Posterior, time: Any = None) -> Any:
    """The result of one series as a `pandas.DataFrame`, one row an instant, for files of estimates.

    Args:
        post: the result.
        time: instants (T,), numbers or dates; 0, 1, 2, … where not given.

    Returns:
        Indexed by `time`: for each state `soc` and `soc std`; for each measurement `voltage measured`,
        `voltage innovation`, `voltage innovation std`; `nis`, and `ess` of particles. What was not kept is left out.
        Units are in `frame.attrs["units"]`, by column, and are stored with a parquet file. `nis` is NaN where nothing
        was measured.

    Raises:
        ValueError: `time` of another length; a batch of results.
        ImportError: pandas is not installed.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)), state_names=("level",))
        >>> list(to_frame(sp.filter(model, jnp.ones((5, 1)), keep=("mean", "std"))).columns)
        ['level', 'level std', 'y0 measured']
    """
    pd = checks.extra("pandas", "to_frame")
    check_single(post)
    T, labels = post.y.shape[0], post.labels
    table: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}

    def add(axis: Axis, kind: str, values: Any) -> None:
        for name, unit, column in zip(*axis, host(values).T if values is not None else ()):
            name += kind
            while name in table:
                name += "_"
            table[name], units[name] = column, unit

    errors, surprises = _errors(post), _innovations(post)
    add(Axis(labels.states, labels.state_units), "", post.mean)
    add(errors, " std", post.std)
    add(Axis(labels.observations, labels.observation_units), " measured", post.y)
    add(surprises, " innovation", post.innovation)
    if post.innovation_cov is not None:
        add(surprises, " innovation std", np.sqrt(np.einsum("tii->ti", host(post.innovation_cov))))
    add(Axis(("nis",), ("1",)), "", None if post.nis is None else _nis(post)[:, None])
    for name in (name for name, axes in post.AXES.items() if axes == ("time",)):
        add(Axis((name,), ("1",)), "", host(getattr(post, name))[:, None])
    frame = pd.DataFrame(table, index=pd.Index(instants(time, T), name="time"))
    frame.attrs["units"] = units
    return frame


def instants(time: Any, T: int) -> np.ndarray:
    """Time stamps of T rows: 0, 1, 2, … where not given; numbers as they are; dates as `datetime64` (UTC if zoned)."""
    if time is None:
        return np.arange(T)
    values = host(time)
    if values.shape != (T,):
        raise ValueError(f"time must be one value for each of the {T} rows, got shape {values.shape}")
    if values.dtype.kind in "OUS":
        try:
            values = np.array([_naive(t) for t in values], "datetime64[us]")
        except (ValueError, TypeError) as error:
            raise ValueError(f"time must be numbers or dates, got {values[0]!r}: {error}") from error
    missing = np.isnat(values) if values.dtype.kind in "mM" else ~np.isfinite(values.astype(float))
    if missing.any():
        raise ValueError(f"time has {int(missing.sum())} missing value(s), the first in row {int(missing.argmax())}")
    return values


def _naive(t: Any) -> Any:
    t = datetime.fromisoformat(t) if isinstance(t, str) else t
    return t.astimezone(UTC).replace(tzinfo=None) if getattr(t, "tzinfo", None) else t


def _nis(post: Posterior) -> np.ndarray:
    """NaN, not 0, where nothing was measured: a file has no degrees of freedom beside it."""
    used = measured_rows(host(post.y), len(_innovations(post).names))
    return np.where(used, host(post.nis), np.nan)


def _errors(post: Posterior) -> Axis:
    """Along `std` and `cov`."""
    return post.labels.directions(_size(post.std, post.cov, default=len(post.labels.states)))


def _innovations(post: Posterior) -> Axis:
    """Along `innovation` and `innovation_cov`."""
    return post.labels.innovations(_size(post.innovation, post.innovation_cov, default=len(post.labels.observations)))


def _size(*kept: Any, default: int) -> int:
    return next((field.shape[1] for field in kept if field is not None), default)
