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
        "extras |= {'optimistix', 'blackjax', 'jsbsim'}; "
        "extra = extras & set(sys.modules); "
        "assert not extra, extra"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


WITHOUT = """
import sys
sys.modules.update(dict.fromkeys(("plotly", "pandas", "optimistix", "blackjax", "jsbsim")))
import matplotlib, jax.numpy as jnp, sigmapoint as sp
from sigmapoint.problems.f15_simulator import advanced
matplotlib.use("Agg")
one = jnp.eye(1)
model = sp.StateSpaceModel(lambda x, u: x, lambda x, u: x, one, one, sp.Gaussian(jnp.zeros(1), one))
post = sp.filter(model, jnp.ones((3, 1)))
post.plot()
for call in (
    lambda: sp.report(post, "report.html"),
    lambda: post.to_frame(),
    lambda: sp.fit(lambda theta: model, 1.0, jnp.ones((3, 1))),
    lambda: sp.pmmh(lambda theta: model, 1.0, jnp.ones((3, 1)), key=0),
    lambda: sp.smc2(lambda theta: model, 1.0, jnp.ones((3, 1)), key=0),
    lambda: advanced(None, None, None),
):
    try:
        call()
    except ImportError as error:
        print(error)
"""


def test_what_is_missing_is_named_where_it_is_needed():
    done = subprocess.run([sys.executable, "-c", WITHOUT], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [
        "report needs plotly: pip install sigmapoint[cli]",
        "to_frame needs pandas: pip install sigmapoint[cli]",
        "fit needs optimistix: pip install sigmapoint[fit]",
        "pmmh needs blackjax: pip install sigmapoint[mcmc]",
        "smc2 needs blackjax: pip install sigmapoint[mcmc]",
        "the F-15 simulator needs jsbsim: pip install sigmapoint[simulator]",
    ]


def test_the_core_asks_for_four_packages():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert {d.split(">")[0] for d in project["dependencies"]} == {"jax", "equinox", "jaxtyping", "numpy"}
