"""What people see when something is wrong: one message on standard error, and an exit code.

2: the input is at fault (the message says what to do); 1: anything else, also a filter of `run` that broke down; 130:
interrupted with Ctrl-C.
"""

import functools
import os
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jax
import typer
from rich.console import Console
from rich.markup import escape

import sigmapoint
from sigmapoint.__main__ import INTERRUPTED

PACKAGE = Path(sigmapoint.__file__).parent
_stopped = threading.Event()


def stopped() -> None:
    """Raise if Ctrl-C was pressed; called between steps, because an interrupt that falls into a callback is lost."""
    if _stopped.is_set():
        raise KeyboardInterrupt


def entered(app: Callable[[], Any]) -> None:
    """Run the command line as a process: remember Ctrl-C, and leave at once after it.

    Leaving in the usual way would tear down the interpreter under a computation that still runs in its own threads.
    """

    def remember(*_: Any) -> None:
        _stopped.set()
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, remember)
    warnings.showwarning = show_warning
    try:
        app()
    except SystemExit as done:
        if done.code == INTERRUPTED:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(INTERRUPTED)
        raise


class InputError(ValueError):
    """Something handed to the command line is wrong; the message says what, where, and what to do."""


def fail(message: str, code: int) -> typer.Exit:
    """Print the message on standard error; the exception to raise."""
    console = Console(stderr=True, highlight=False)
    console.print(f"[bold red]error:[/] {escape(message)}", soft_wrap=True)
    return typer.Exit(code)


def show_warning(message: Warning | str, category: type[Warning], filename: str, lineno: int, *_: Any) -> None:
    """Print a warning on standard error as a line for people, with the place where it arose if that is not in here."""
    place = "" if Path(filename).is_relative_to(PACKAGE) else f" ({filename}, line {lineno})"
    console = Console(stderr=True, highlight=False)
    console.print(f"[bold yellow]warning:[/] {escape(f'{message}{place}')}", soft_wrap=True)


def guarded(command: Callable[..., None]) -> Callable[..., None]:
    """A command in 64-bit numbers (or `--float32`) that ends with a message; with `--debug`, a traceback."""

    @functools.wraps(command)
    def run(*args: Any, debug: bool = False, **options: Any) -> None:
        try:
            with precision(float32=bool(options.get("float32"))):
                command(*args, debug=debug, **options)
        except KeyboardInterrupt as error:
            raise fail("interrupted; no half-written files are left behind", INTERRUPTED) from error
        except Exception as error:
            if debug or isinstance(error, typer.Exit):
                raise
            raise fail(*_explained(error)) from error

    return run


def _explained(error: Exception) -> tuple[str, int]:
    if isinstance(error, ValueError):
        return str(error), 2
    if isinstance(error, OSError):
        return f"{error.strerror or error}: {error.filename}" if error.filename else str(error), 2
    return f"{named(error)} (run again with --debug for the traceback)", 1


def named(error: BaseException) -> str:
    """Its type, and what it says in one line."""
    first = str(error).strip().split("\n")[0]
    notes = [note for note in getattr(error, "__notes__", ()) if "\n" not in note]  # ours; those of JAX are longer
    return "; ".join([f"{type(error).__name__}: {first}" if first else type(error).__name__, *notes])


@contextmanager
def blaming(path: Path) -> Iterator[None]:
    """Errors whose traceback passes through the user's file become an `InputError` with its line."""
    try:
        yield
    except InputError:
        raise
    except SyntaxError as error:
        raise InputError(f"{path}, line {error.lineno}: {error.msg}") from error
    except Exception as error:
        lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
        if not lines:
            raise
        raise InputError(f"{path}, line {lines[-1]}: {named(error)}") from error


@contextmanager
def precision(float32: bool) -> Iterator[None]:
    """64-bit numbers inside, or 32-bit ones; afterwards as before."""
    before = jax.config.read("jax_enable_x64")
    jax.config.update("jax_enable_x64", not float32)
    try:
        yield
    finally:
        jax.config.update("jax_enable_x64", before)


def folder(out: Path) -> Path:
    """`out`, where it is a folder that can be written or made; found out before anything is computed."""
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out} is a file; name a folder")
    nearest = next(p for p in (out, *out.absolute().parents) if p.exists())
    if not nearest.is_dir():
        raise InputError(f"--out {out}: {nearest} is a file; name a folder")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(f"--out {out}: no permission to write in {nearest}")
    return out
