"""`sigmapoint doctor`: what the library runs on, and whether it is as fast as it can be."""

import os
import platform
from importlib.metadata import version
from typing import Annotated, Any

import typer
from rich.console import Console

from sigmapoint.cli.errors import guarded
from sigmapoint.cli.run import Debug

PACKAGES = ("sigmapoint", "jax", "jaxlib", "equinox", "jaxtyping", "numpy")


@guarded
def doctor(
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object in place of lines.")] = False,
    debug: Debug = False,
) -> None:
    """Show the loop setting, devices, number format and versions; copy it into a bug report."""
    found = examined()
    console = Console()
    if as_json:
        console.print_json(data=found)
        return
    for name, value in found.items():
        console.print(f"{name:<12} {value}", markup=False, highlight=False, soft_wrap=True)


def examined() -> dict[str, Any]:
    """What `doctor` prints, by name."""
    import jax
    import jax.numpy as jnp

    from sigmapoint.compiled import runtime

    return {
        "loops": f"{'native' if runtime.NATIVE else 'not native'} ({runtime.REASON})",
        "devices": ", ".join(f"{d.platform}:{d.id} {d.device_kind}" for d in jax.devices()),
        "cores": os.cpu_count(),
        "numbers": str(jnp.zeros(()).dtype),
        "XLA_FLAGS": os.environ.get("XLA_FLAGS", ""),
        "python": platform.python_version(),
        **{name: version(name) for name in PACKAGES},
    }
