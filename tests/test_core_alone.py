"""The core needs jax, equinox, jaxtyping and numpy, and nothing of the extras."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def test_importing_the_core_imports_no_extra():
    code = (
        "import sys, sigmapoint; "
        "extras = {'pandas', 'plotly', 'matplotlib', 'scipy.stats', 'typer', 'rich', 'xarray', 'pyarrow'}; "
        "extras |= {'optimistix', 'blackjax', 'jsbsim'}; "
        "extra = extras & set(sys.modules); "
        "assert not extra, extra"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


WITHOUT = """
import sys
sys.modules.update({{"plotly": None, "pandas": None, "optimistix": None, "blackjax": None, "jsbsim": None}})
import matplotlib, jax.numpy as jnp, sigmapoint as sp
matplotlib.use("Agg")
one = jnp.eye(1)
model = sp.StateSpaceModel(lambda x, u: x, lambda x, u: x, one, one, sp.Gaussian(jnp.zeros(1), one))
post = sp.filter(model, jnp.ones((3, 1)))
{}
"""


@pytest.mark.parametrize(
    ("call", "said"),
    [
        ("sp.report(post, 'report.html')", "ImportError: report needs plotly: pip install sigmapoint[cli]"),
        ("post.to_frame()", "ImportError: to_frame needs pandas: pip install sigmapoint[cli]"),
        (
            "sp.fit(lambda theta: model, 1.0, jnp.ones((3, 1)))",
            "ImportError: fit needs optimistix: pip install sigmapoint[fit]",
        ),
        (
            "sp.pmmh(lambda theta: model, 1.0, jnp.ones((3, 1)), key=0)",
            "ImportError: pmmh needs blackjax: pip install sigmapoint[mcmc]",
        ),
        (
            "sp.smc2(lambda theta: model, 1.0, jnp.ones((3, 1)), key=0)",
            "ImportError: smc2 needs blackjax: pip install sigmapoint[mcmc]",
        ),
        (
            "from sigmapoint.problems.f15_simulator import advanced; advanced(None, None, None)",
            "ImportError: the f15 needs jsbsim: pip install sigmapoint[simulator]",
        ),
        ("post.plot()", ""),
    ],
)
def test_what_is_missing_is_named_where_it_is_needed(call, said):
    done = subprocess.run([sys.executable, "-c", WITHOUT.format(call)], capture_output=True, text=True)
    assert (done.stderr.splitlines() or [""])[-1] == said


def test_the_core_asks_for_four_packages():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert {d.split(">")[0] for d in project["dependencies"]} == {"jax", "equinox", "jaxtyping", "numpy"}
