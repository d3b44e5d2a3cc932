"""MODEL.py: a model and which columns of the data go where.

`model` or `build(u, time)`, `measurements`, `inputs`, `time`, `interval`, `truth`: what each of these names in the file
means is in docs/tutorials/commandline.md.

Units in the headers are carried into the outputs, where the model itself names none.
"""

import dataclasses
import inspect
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Float

from sigmapoint.cli import data
from sigmapoint.cli.errors import InputError, blaming
from sigmapoint.model import StateSpaceModel
from sigmapoint.results import Labels, Posterior

Columns = dict[str, data.Column]


class Problem(NamedTuple):
    """A model with its data; row k of everything belongs to the same instant."""

    model: StateSpaceModel
    y: Float[np.ndarray, "T m"]
    u: Any
    clock: data.Clock
    truth: Float[np.ndarray, "T d"] | None
    labels: Labels

    def labelled(self, post: Posterior) -> Posterior:
        """The posterior with names and units of the data."""
        return dataclasses.replace(post, labels=self.labels)


def load(model_path: Path, data_path: Path) -> Problem:
    """The problem that MODEL.py states for DATA.

    Raises:
        InputError: a file that is missing or wrong; the message names it and the line, column or row.
    """
    names = _executed(model_path)
    frame = data.read(data_path)
    clock = data.clock(frame, _time(names, model_path))
    columns = _columns(frame, names, "inputs", model_path, complete=True)
    u = {key: column.values for key, column in columns.items()} | _interval(names, model_path, columns, clock)
    model = _model(names, model_path, u, clock)
    measured = _measurements(frame, names, model, model_path)
    truth = _truth(frame, names, model, model_path)
    y = np.stack([column.values for column in measured.values()], axis=1)
    inputs = {key: jnp.asarray(value) for key, value in u.items()} or None
    return Problem(model, y, inputs, clock, _states(model, truth), _labels(model, measured, truth))


def _executed(path: Path) -> Mapping[str, Any]:
    """What the file defines; it can import its neighbours, as a script can."""
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if path.name.lower().endswith(data.ENDINGS):
        raise InputError(f"{path} is data, not Python: the order is MODEL.py, then DATA")
    module = ModuleType(path.stem)
    module.__file__ = str(path)
    neighbours = str(path.resolve().parent)
    if neighbours not in sys.path:
        sys.path.insert(0, neighbours)
    with blaming(path):
        exec(compile(path.read_bytes(), str(path), "exec"), module.__dict__)
    return module.__dict__


def _time(names: Mapping[str, Any], path: Path) -> str | None:
    time = names.get("time")
    if not isinstance(time, str | None):
        raise InputError(f"{path}: `time` must be the name of a column, got {type(time).__name__}; rename others")
    return time


def _interval(names: Mapping[str, Any], path: Path, inputs: Columns, clock: data.Clock) -> dict[str, np.ndarray]:
    """The distance of each row to the next as an input, where one is to be."""
    key = names.get("interval")
    if key is None:
        return {}
    if not isinstance(key, str) or key in inputs:
        raise InputError(f"{path}: `interval` must be a key of u that no column of `inputs` has, got {key!r}")
    return {key: np.diff(clock.numbers, append=clock.numbers[-1])}


def _model(names: Mapping[str, Any], path: Path, u: dict[str, np.ndarray], clock: data.Clock) -> StateSpaceModel:
    if ("model" in names) == ("build" in names):
        found = "both" if "model" in names else "neither"
        raise InputError(
            f"{path} must define either `model` or `build(u, time)`; it has {found}; helpers need other names"
        )
    with blaming(path):
        model = names["model"] if "model" in names else _called(names["build"], path, u, clock.numbers)
    if not isinstance(model, StateSpaceModel):
        source = "`model`" if "model" in names else "what `build` returns"
        raise InputError(f"{path}: {source} must be a sp.StateSpaceModel, got {type(model).__name__}")
    return model


def _called(build: Any, path: Path, *given: Any) -> Any:
    try:
        inspect.signature(build).bind(*given)
    except TypeError as error:
        raise InputError(f"{path}: `build` must be a function that is called as build(u, time): {error}") from error
    return build(*given)


def _wanted(names: Mapping[str, Any], name: str, path: Path) -> dict[str, str]:
    """Key -> column; a list of columns has their names as keys."""
    value = names.get(name, {})
    pairs = list(value.items()) if isinstance(value, Mapping) else [(column, column) for column in _listed(value)]
    if not all(isinstance(text, str) for pair in pairs for text in pair) or len(dict(pairs)) < len(pairs):
        raise InputError(f"{path}: `{name}` must be a dict of names to columns, or a list of columns, got {value!r}")
    return {data.header(key)[0] if key == column else key: column for key, column in pairs}


def _listed(value: Any) -> list[Any]:
    return list(value) if isinstance(value, Sequence) and not isinstance(value, str) else [(None,)]


def _columns(frame: pd.DataFrame, names: Mapping[str, Any], name: str, path: Path, *, complete: bool) -> Columns:
    wanted = _wanted(names, name, path)
    return {key: data.column(frame, text, f"{name} {key!r}", complete=complete) for key, text in wanted.items()}


def _measurements(frame: pd.DataFrame, names: Mapping[str, Any], model: StateSpaceModel, path: Path) -> Columns:
    columns = _columns(frame, names, "measurements", path, complete=False)
    if not columns:
        raise InputError(f"{path} must define `measurements`, a list of columns such as ['voltage']")
    if model.observation_names is None:
        return columns
    own = ", ".join(model.observation_names)
    if not isinstance(names["measurements"], Mapping):
        order = {name.casefold(): i for i, name in enumerate(model.observation_names)}
        if any(order.get(name.casefold(), i) != i for i, name in enumerate(columns)):
            raise InputError(
                f"{path}: a list of `measurements` must be in the order of the model's observation_names, {own}, got "
                f"{', '.join(columns)}; or write a dict"
            )
        return columns
    if set(columns) != set(model.observation_names):
        raise InputError(
            f"{path}: `measurements` names {', '.join(columns)}, but the model's observation_names are {own}"
        )
    return {name: columns[name] for name in model.observation_names}


def _truth(frame: pd.DataFrame, names: Mapping[str, Any], model: StateSpaceModel, path: Path) -> Columns:
    columns = _columns(frame, names, "truth", path, complete=False)
    unknown = [name for name in columns if name not in model.state_names]
    if unknown:
        states = ", ".join(model.state_names)
        raise InputError(f"{path}: `truth` has {unknown[0]!r}, no state of the model; its state_names are {states}")
    return columns


def _states(model: StateSpaceModel, truth: Columns) -> Float[np.ndarray, "T d"] | None:
    if not truth:
        return None
    T = next(iter(truth.values())).values.size
    unknown = np.full(T, np.nan)
    return np.stack([truth[name].values if name in truth else unknown for name in model.state_names], axis=1)


def _labels(model: StateSpaceModel, measured: Columns, truth: Columns) -> Labels:
    own = model.observation_units or ("",) * len(measured)
    known = {name: column.unit for name, column in truth.items()}
    return Labels(
        states=model.state_names,
        state_units=tuple(unit or known.get(name, "") for name, unit in zip(model.state_names, model.state_units)),
        observations=model.observation_names or tuple(measured),
        observation_units=tuple(unit or column.unit for unit, column in zip(own, measured.values())),
        state_space=model.state_space,
        observation_space=model.observation_space,
    )
