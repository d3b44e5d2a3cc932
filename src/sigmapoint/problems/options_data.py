"""Real options on the FTSE-100 index, from a folder of one's own: the data carry no licence to be passed on.

A file for each option, `c2925.prn` the calls and `p2925.prn` the puts of strike 2925: no header, a row for each trading
day from 1994-02-01 to 1994-12-16 with its number (days since 1899-12-30, as spreadsheets count), the price of the
option and the index, [index points] both, with blanks or tabs between. All files have the same days and the same index.
"""

from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Bool

from sigmapoint.problems.options_market import FINAL, STRIKES, Market, maturity

COLUMNS = ("day", "price", "index")
FILES = f"c and p files ({', '.join(f'c{strike}.prn' for strike in STRIKES)}, and p in place of c)"
EPOCH = "1899-12-30"


def ftse100(folder: Path) -> Market:
    """Load calls and puts of all strikes.

    Args:
        folder: with the files.

    Returns:
        The market, with dates.

    Raises:
        FileNotFoundError: the folder, or one of the files, is not there.
        ValueError: a file that is not as described, or not of the same days and index as the first; the message names
            it, and the row.
    """
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder} is not a folder; name the one with the {FILES}")
    tables = {kind: [_table(folder / f"{kind}{strike}.prn") for strike in STRIKES] for kind in "cp"}
    first = tables["c"][0]
    for kind, each in tables.items():
        for strike, table in zip(STRIKES, each):
            _check_same(first, table, folder / f"{kind}{strike}.prn", f"c{STRIKES[0]}.prn")
    call, put = (np.stack([table["price"].to_numpy() for table in each], axis=1) for each in tables.values())
    dates = pd.to_datetime(first["day"], unit="D", origin=EPOCH).to_numpy("datetime64[D]")
    return Market(STRIKES, dates, maturity(len(first)), first["index"].to_numpy(), call, put)


def _table(path: Path) -> pd.DataFrame:
    """The rows of a file, checked."""
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file; the folder must hold {FILES}")
    try:
        table = pd.read_csv(path, sep=r"\s+", header=None, dtype=float, engine="c", index_col=False)
    except pd.errors.EmptyDataError as error:
        raise ValueError(f"{path} is empty; it should have rows of {', '.join(COLUMNS)}") from error
    except (ValueError, pd.errors.ParserError) as error:
        raise ValueError(f"{path} is not a table of numbers {', '.join(COLUMNS)}: {str(error).strip()}") from error
    if table.shape[1] != len(COLUMNS):
        raise ValueError(f"{path} has {table.shape[1]} columns; it should have three: {', '.join(COLUMNS)}")
    table.columns = list(COLUMNS)
    _check_rows(path, table)
    return table


def _check_rows(path: Path, table: pd.DataFrame) -> None:
    values = table.to_numpy()
    if len(table) > FINAL:
        raise ValueError(f"{path} has {len(table)} rows; the options run out on trading day {FINAL}")
    _check_each(path, np.all(np.isfinite(values), axis=1), "needs three finite numbers")
    _check_each(path, values[:, 1] >= 0, "has a price below zero")
    _check_each(path, values[:, 2] > 0, "has an index of zero or less")
    _check_each(path, np.diff(values[:, 0], prepend=-np.inf) > 0, "is of no later day than the row before")


def _check_each(path: Path, good: Bool[np.ndarray, "T"], fault: str) -> None:
    if not good.all():
        raise ValueError(f"{path}: row {np.argmin(good) + 1} {fault}")


def _check_same(first: pd.DataFrame, table: pd.DataFrame, path: Path, other: str) -> None:
    if len(table) != len(first):
        raise ValueError(f"{path} has {len(table)} rows, {other} has {len(first)}; both should have the same days")
    for column in ("day", "index"):
        same = table[column].to_numpy() == first[column].to_numpy()
        _check_each(path, same, f"has another {column} than {other}")
