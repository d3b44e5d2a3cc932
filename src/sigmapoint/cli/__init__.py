"""The command line: `sigmapoint demo | run | compare | bench | reproduce | doctor`. One file a command."""

from typing import Annotated

import typer

from sigmapoint import __version__
from sigmapoint.cli.bench import bench
from sigmapoint.cli.cache import kept_between_runs
from sigmapoint.cli.compare import compare
from sigmapoint.cli.demo import demo
from sigmapoint.cli.doctor import doctor
from sigmapoint.cli.errors import entered
from sigmapoint.cli.reproduce import reproduce
from sigmapoint.cli.run import run

app = typer.Typer(
    help="Nonlinear estimation with sigma-point Kalman filters. Computes in 64-bit numbers.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    add_completion=False,
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"sigmapoint {__version__}")
        raise typer.Exit


Version = Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")]


@app.callback()
def options(version: Version = False) -> None:
    """Nonlinear estimation with sigma-point Kalman filters. Computes in 64-bit numbers."""
    kept_between_runs()


for command in (demo, run, compare, bench, reproduce, doctor):
    app.command()(command)


def main() -> None:
    """Entry point of the console script `sigmapoint`."""
    entered(lambda: app(prog_name="sigmapoint"))
