"""Results as labelled tables: `xarray.Dataset` and `pandas.DataFrame`, with the units of every column."""

from datetime import UTC, datetime
from typing import Any

import numpy as np

from sigmapoint.results import Posterior, check_single, host, input_columns


def to_xarray(post: Posterior, time: Any = None) -> Any:
    """The result of one series as an `xarray.Dataset`.

    Args:
        post: the result.
        time: instants (T,), numbers or dates; 0, 1, 2, … where not given.

    Returns:
        `mean`, `std` (time, state), `cov` (time, state, state2), `innovation` (time, observation), `innovation_cov`,
        `nis` (time), `y`, and `u` (time, input) where inputs are numeric columns; what was not kept is left out.
        Coordinates `state_unit` and `observation_unit`; attribute `log_likelihood`.

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
    try:
        import xarray as xr
    except ImportError as error:
        raise ImportError("to_xarray needs xarray: pip install sigmapoint[cli]") from error
    check_single(post)
    T, labels = post.y.shape[0], post.labels
    tangent = _directions(post)
    state, delta = "state", "state" if tangent == labels.states else "tangent"
    dims = {
        "mean": ("time", state),
        "std": ("time", delta),
        "cov": ("time", delta, f"{delta}2"),
        "innovation": ("time", "observation"),
        "innovation_cov": ("time", "observation", "observation2"),
        "nis": ("time",),
    }
    kept = {name: getattr(post, name) for name in dims}
    fields = {name: (dims[name], host(values)) for name, values in kept.items() if values is not None}
    sensed = "observation" if post.y.shape[1] == len(labels.observations) else "measured"
    if post.nis is not None:
        fields["nis"] = (("time",), _nis(post))
    fields["y"] = (("time", sensed), host(post.y))
    inputs = input_columns(post.u, T)
    if inputs:
        fields["u"] = (("time", "input"), np.stack(list(inputs.values()), 1))
    coords: dict[str, Any] = {
        "time": instants(time, T),
        state: list(labels.states),
        "observation": list(labels.observations),
        "observation2": list(labels.observations),
        f"{delta}2": list(tangent),
        "state_unit": (state, list(labels.state_units)),
        "observation_unit": ("observation", list(labels.observation_units)),
    } | ({"input": list(inputs)} if inputs else {})
    data = xr.Dataset(fields, coords, {"log_likelihood": float(post.log_likelihood)})
    for name in {"mean", "std"} & set(data):
        data[name].attrs["units"] = list(labels.state_units)
    for name in {"innovation", "y"} & set(data):
        data[name].attrs["units"] = list(labels.observation_units)
    return data


def to_frame(post: Posterior, time: Any = None) -> Any:
    """The result of one series as a `pandas.DataFrame`, one row an instant, for files of estimates.

    Args:
        post: the result.
        time: instants (T,), numbers or dates; 0, 1, 2, … where not given.

    Returns:
        Indexed by `time`: for each state `soc` and `soc std`; for each measurement `voltage measured`,
        `voltage innovation`, `voltage innovation std`; `nis`. What was not kept is left out. Units are in
        `frame.attrs["units"]`, by column, and are stored with a parquet file. `nis` is NaN where nothing was measured.

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
    try:
        import pandas as pd
    except ImportError as error:
        raise ImportError("to_frame needs pandas: pip install sigmapoint[cli]") from error
    check_single(post)
    T, labels = post.y.shape[0], post.labels
    table: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}

    def add(names: tuple[str, ...], kind: str, values: Any, unit: tuple[str, ...]) -> None:
        for i, column in enumerate(host(values).T if values is not None else ()):
            name = f"{names[i]}{kind}" if i < len(names) else f"y{i}{kind}"
            while name in table:
                name += "_"
            table[name], units[name] = column, unit[i] if i < len(unit) else ""

    tangent = _directions(post)
    add(labels.states, "", post.mean, labels.state_units)
    add(tangent, " std", post.std, labels.state_units if tangent == labels.states else ())
    add(labels.observations, " measured", post.y, labels.observation_units)
    add(labels.observations, " innovation", post.innovation, labels.observation_units)
    if post.innovation_cov is not None:
        spread = np.sqrt(np.einsum("tii->ti", host(post.innovation_cov)))
        add(labels.observations, " innovation std", spread, labels.observation_units)
    add(("nis",), "", None if post.nis is None else _nis(post)[:, None], ("1",))
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
    return np.where(np.isnan(host(post.y)).all(1), np.nan, host(post.nis))


def _directions(post: Posterior) -> tuple[str, ...]:
    """Names along `std` and `cov`."""
    kept = [a.shape[1] for a in (post.std, post.cov) if a is not None]
    return post.labels.directions(kept[0] if kept else len(post.labels.states))
