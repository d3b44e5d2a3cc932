"""Logged data from CSV or Parquet: columns looked up by name, with or without the unit in their header.

A header is a name with or without a unit, `voltage [V]` or `Voltage(V)`. A wanted column matches a header that is the
same text; else one with the same name (upper or lower case) and, where the wanted column has a unit, the same unit.
"""

import re
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float

from sigmapoint.cli.errors import InputError
from sigmapoint.plotting import titled

HEADER = re.compile(r"^(?P<name>.*?\S)\s*(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>[^()]*)\))$")
FORMATS = ".csv, .csv.gz or .parquet"
ENDINGS = (".csv", ".csv.gz", ".parquet")


class Column(NamedTuple):
    """One column: its values (T,), NaN where a cell is empty; the name and unit in its header."""

    name: str
    unit: str
    values: Float[np.ndarray, "T"]


class Clock(NamedTuple):
    """Time of each row: as a number (seconds since the first row for dates), and as it stands in the file."""

    numbers: Float[np.ndarray, "T"]
    shown: Any
    unit: str = ""

    @property
    def label(self) -> str:
        """For an axis, with the unit."""
        return titled("time", self.unit)


def read(path: Path) -> pd.DataFrame:
    """The table in a file, under its headers as they stand there.

    Raises:
        InputError: no such file, another format, an empty file, no rows, or rows that do not fit the header.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    name = path.name.lower()
    if not name.endswith(ENDINGS):
        raise InputError(f"{path}: data must be {FORMATS}")
    frame = _parquet(path) if name.endswith(".parquet") else _csv(path)
    if len(frame) == 0:
        raise InputError(f"{path} has a header ({listed(frame)}) but no rows")
    return frame


def _parquet(path: Path) -> pd.DataFrame:
    try:
        frame = pd.read_parquet(path).reset_index(drop=False)
    except (OSError, ValueError) as error:
        raise InputError(f"{path} is not a Parquet file: {error}") from error
    return frame.rename(columns=str)


def _csv(path: Path) -> pd.DataFrame:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            frame = pd.read_csv(path, index_col=False, low_memory=False, encoding="utf-8-sig")
        raw = pd.read_csv(path, header=None, nrows=1, dtype=str, encoding="utf-8-sig")
    except pd.errors.EmptyDataError as error:
        raise InputError(f"{path} is empty") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not UTF-8 text; save it as CSV in UTF-8") from error
    except (pd.errors.ParserError, pd.errors.ParserWarning, OSError, EOFError) as error:
        raise InputError(f"{path} cannot be read as CSV: {str(error).strip()}") from error
    if raw.shape[1] == frame.shape[1]:  # pandas renames columns that are there twice; the file decides
        frame.columns = [str(h) if isinstance(h, str) else f"column {i + 1}" for i, h in enumerate(raw.iloc[0])]
    return frame


def listed(frame: pd.DataFrame) -> str:
    """The headers, for a message."""
    names = [repr(str(name)) for name in frame.columns]
    return ", ".join(names[:40]) + (f" and {len(names) - 40} more" if len(names) > 40 else "")


def header(text: str) -> tuple[str, str]:
    """Name and unit in a header; the unit is empty where there is none."""
    match = HEADER.match(text.strip())
    return (match["name"], (match["square"] or match["round"] or "").strip()) if match else (text.strip(), "")


def locate(frame: pd.DataFrame, wanted: str, role: str) -> int:
    """Position of a column.

    Raises:
        InputError: no such column, or more than one; the message lists what is there.
    """
    headers = [str(h) for h in frame.columns]
    same = [i for i, h in enumerate(headers) if h.strip() == wanted.strip()]
    found = same or [i for i, h in enumerate(headers) if _matches(header(wanted), header(h))]
    if len(found) == 1:
        return found[0]
    if found:
        candidates = ", ".join(repr(headers[i]) for i in found)
        raise InputError(f"{role}: column {wanted!r} is ambiguous, it matches {candidates}; write the header in full")
    hint = "; the file seems to use another separator: save it with commas" if _semicolons(headers) else ""
    raise InputError(f"{role}: no column {wanted!r} in the data, which has {listed(frame)}{hint}")


def _matches(wanted: tuple[str, str], there: tuple[str, str]) -> bool:
    return wanted[0].casefold() == there[0].casefold() and wanted[1] in ("", there[1])


def _semicolons(headers: list[str]) -> bool:
    return len(headers) == 1 and any(mark in headers[0] for mark in ";\t|")


def column(frame: pd.DataFrame, wanted: str, role: str, *, complete: bool) -> Column:
    """A numeric column.

    Args:
        frame: the data.
        wanted: its header, with or without the unit.
        role: what it is used as, for messages.
        complete: whether empty cells are refused; otherwise they are NaN, not measured.

    Raises:
        InputError: missing or ambiguous; text or an infinite number in it; an empty cell where `complete`.
    """
    series = frame.iloc[:, locate(frame, wanted, role)]
    name, unit = header(str(series.name))
    where = f"{role}: column {str(series.name)!r}"
    numbers = pd.Series(pd.to_numeric(series, errors="coerce"))
    text = np.asarray(numbers.isna() & series.notna())
    if text.any():
        row = int(np.argmax(text))
        raise InputError(f"{where} must be numbers, but holds {str(series.iloc[row])[:40]!r} in data row {row + 1}")
    values = np.asarray(numbers.astype("Float64").to_numpy(float, na_value=np.nan), np.float64)
    if np.isinf(values).any():
        row = int(np.argmax(np.isinf(values))) + 1
        raise InputError(f"{where} is infinite in data row {row}; leave cells empty where nothing was measured")
    if complete and np.isnan(values).any():
        row = int(np.argmax(np.isnan(values))) + 1
        raise InputError(f"{where} is empty in data row {row}, but must be known; interpolate, or hold the last value")
    return Column(name, unit, values)


def clock(frame: pd.DataFrame, wanted: str | None) -> Clock:
    """Time of the rows from a column of numbers or dates; row numbers 0, 1, 2, … where no column is named."""
    if wanted is None:
        numbers = np.arange(len(frame), dtype=np.float64)
        return Clock(numbers, numbers, "samples")
    series = frame.iloc[:, locate(frame, wanted, "time")]
    dates = None if pd.api.types.is_numeric_dtype(series) else _dates(series)
    if dates is None:
        numbers = shown = column(frame, wanted, "time (numbers, or dates like 2024-01-31 12:00)", complete=True).values
    else:
        shown = dates.to_numpy()
        numbers = (dates - dates.iloc[0]).dt.total_seconds().to_numpy(np.float64)
    back = np.diff(numbers) < 0
    if back.any():
        row = int(np.argmax(back)) + 2
        raise InputError(f"time: column {str(series.name)!r} goes back in data row {row}; sort the rows by time")
    return Clock(numbers, shown, header(str(series.name))[1])


def _dates(series: pd.Series) -> pd.Series | None:
    try:
        dates = pd.to_datetime(series, utc=getattr(series.dtype, "tz", None) is not None, format="ISO8601")
    except (ValueError, TypeError):
        return None
    return None if dates.isna().any() else dates
