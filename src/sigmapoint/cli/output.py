"""What commands leave behind: files, all of them or none, and tables on the screen."""

import json
import os
import platform
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from textwrap import fill
from typing import IO, Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from sigmapoint.cli.errors import stopped
from sigmapoint.comparison import as_text
from sigmapoint.diagnosis.consistency import surprise
from sigmapoint.results import Posterior, field
from sigmapoint.storage import write_atomically

KEPT = 30
"""Numbers, and words up to this length, stay on one line of a table."""

Writer = Callable[[IO[bytes]], Any]


def versions() -> dict[str, str]:
    """Versions of what computed the results."""
    packages = ("sigmapoint", "jax", "numpy", "pandas")
    return {"python": platform.python_version(), **{name: version(name) for name in packages}}


def plain(value: Any) -> Any:
    """As JSON can hold it: lists and numbers, null for NaN and infinity."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value


def json_file(content: Any) -> Writer:
    """Writes valid JSON."""
    text = json.dumps(plain(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    return lambda file: file.write(text.encode())


def parquet_file(frame: Any) -> Writer:
    """Writes a data frame with its columns, units included in the headers."""
    return lambda file: frame.to_parquet(file, index=False)


def page_file(result: Any, **options: Any) -> Writer:
    """Writes the report page of a result."""

    def write(file: IO[bytes]) -> None:
        from sigmapoint.reporting import report

        with tempfile.TemporaryDirectory() as scratch:
            report(result, Path(scratch) / "report.html", **options)
            file.write((Path(scratch) / "report.html").read_bytes())

    return write


def write_all(out: Path, files: Mapping[str, Writer]) -> list[Path]:
    """Write every file into `out`; where one fails, none appears and older ones stay as they were."""
    made = [p for p in (out, *out.parents) if not p.exists()]
    out.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryDirectory(dir=out, prefix=".writing-") as staging:
            for name, write in files.items():
                write_atomically(Path(staging) / name, write)
            stopped()
            for name in files:
                os.replace(Path(staging) / name, out / name)
    except BaseException:
        for folder in made:
            folder.rmdir()
        raise
    return [out / name for name in files]


def innovations(post: Posterior) -> dict[str, Any]:
    """Summary of the NIS, see `Surprise`."""
    return surprise(field(post, "innovation"), field(post, "nis"))._asdict()


def table(title: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    """Rows as a rich table; columns in the order in which they first appear, those that are empty left out."""
    columns = dict.fromkeys(name for row in rows for name, value in row.items() if value not in ("", None))
    made = Table(title=escape(title), title_justify="left", title_style="bold", box=SIMPLE_HEAD)
    made.collapse_padding, made.pad_edge = True, False
    for name in columns:
        words = all(isinstance(row.get(name, ""), str) for row in rows)
        widest = max(len(as_text(row.get(name))) for row in rows)
        narrowest = max(*map(len, name.split()), 0 if words and widest > KEPT else widest)
        heading = escape(fill(name, max(narrowest, min(widest, KEPT)), break_long_words=False))
        made.add_column(heading, justify="left" if words else "right", overflow="fold", min_width=narrowest)
    for row in rows:
        made.add_row(*(escape(as_text(row.get(name))) for name in columns))
    return made


def noted(console: Console, title: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Print the rows of methods as a table, and their notes below it."""
    console.print(table(title, [{k: v for k, v in row.items() if k != "note"} for row in rows]))
    for row in rows:
        if row.get("note"):
            console.print(f"{row['method']}: {row['note']}", markup=False, highlight=False)


def written(console: Console, files: Sequence[Path]) -> None:
    """Say where the files are."""
    for path in files:
        console.print(f"wrote {escape(str(path))}", soft_wrap=True, highlight=False)


@contextmanager
def progress(total: int | None) -> Iterator[Callable[[str], None]]:
    """A bar on standard error; what is yielded is called with each step before it begins."""
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total}"))
    bar = Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True), transient=True)
    with bar:
        task = bar.add_task("starting", total=total)
        begun = False

        def step(description: str) -> None:
            nonlocal begun
            stopped()
            bar.update(task, description=escape(description), advance=int(begun))
            begun = True

        yield step
