"""The core needs jax, equinox, jaxtyping and numpy, and nothing of the extras."""

import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_importing_the_core_imports_no_extra():
    code = (
        "import sys, sigmapoint; "
        "extras = {'pandas', 'plotly', 'matplotlib', 'scipy.stats', 'typer', 'rich', 'xarray', 'pyarrow'}; "
        "extra = extras & set(sys.modules); "
        "assert not extra, extra"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_core_asks_for_four_packages():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert {d.split(">")[0] for d in project["dependencies"]} == {"jax", "equinox", "jaxtyping", "numpy"}
