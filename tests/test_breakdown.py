"""Estimates that are no numbers are warned of, whatever was measured: to whoever called, and of which series."""

import subprocess
import sys

import jax.numpy as jnp
import numpy as np
import pytest

import sigmapoint as sp

ONE = np.eye(1)
GAP = np.array([[1.0], [np.nan], [np.nan], [np.nan]])
"""broken where nothing is measured any more"""


def model(dynamics, observation=lambda x, u: x):
    return sp.StateSpaceModel(dynamics, observation, ONE, ONE, sp.Gaussian(np.zeros(1), ONE))


BROKEN = model(lambda x, u: jnp.sqrt(x - 5.0))
HALF_BROKEN = model(lambda x, u: jnp.sqrt(u) * x)
"""by its input"""


def lost(what):
    return pytest.warns(UserWarning, match=f"the {what} is not finite")


@pytest.mark.parametrize("run", [sp.filter, sp.smooth])
def test_a_model_that_gives_nan(run):
    with lost("log-likelihood"):
        run(BROKEN, np.ones((4, 1)))


@pytest.mark.parametrize(
    ("run", "method"),
    [(sp.filter, sp.ekf()), (sp.filter, sp.srcdkf()), (sp.filter, sp.bootstrap(20)), (sp.smooth, sp.srcdkf())],
    ids=["ekf", "srcdkf", "bootstrap", "smoothed"],
)
def test_a_model_that_gives_nan_where_nothing_is_measured(run, method):
    with lost("mean"):
        run(BROKEN, GAP, method=method, key=0)


def test_a_likelihood_that_is_infinite():
    with lost("log-likelihood"):
        sp.filter(model(lambda x, u: x, lambda x, u: x + 1e200), np.ones((4, 1)))


def test_of_what_was_not_kept_nothing_is_said():
    assert sp.filter(BROKEN, GAP, keep=()).mean is None
    with lost("std"):
        sp.filter(BROKEN, GAP, keep=("std",))


@pytest.mark.parametrize("together", [np.array, list], ids=["array", "list"])
@pytest.mark.parametrize(("y", "what"), [(np.ones((4, 1)), "log-likelihood"), (GAP, "mean")])
def test_the_series_is_named(together, y, what):
    with lost(f"{what} of series 1"):
        sp.batch(HALF_BROKEN, together([y, y]), together([np.ones(4), -np.ones(4)]))


def test_a_diagnosis_counts_what_was_lost_where_nothing_was_measured():
    with lost("mean"):
        found = sp.diagnose(sp.filter(BROKEN, GAP))
    assert found.lost == 3
    assert "The filter broke down: 3 sample(s) have no finite estimate" in str(found)
    assert "good" not in {verdict.severity for verdict in found.verdicts}


CALLED = """
import warnings
import jax.numpy as jnp, numpy as np, sigmapoint as sp
one = np.eye(1)
model = sp.StateSpaceModel(lambda x, u: jnp.sqrt(x - 5), lambda x, u: x, one, one, sp.Gaussian(np.zeros(1), one))
y = np.ones((4, 1))
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    sp.filter(model, y)
    sp.smooth(model, y)
    sp.batch(model, [y, y])
    sp.filter(model, y, method=sp.bootstrap(10), key=0)
assert [(w.filename, w.lineno) for w in caught] == [("<string>", line) for line in range(9, 13)], caught
"""


def test_the_line_that_called_is_named():
    """In a process without the run-time checks of shapes, whose frames stand between."""
    subprocess.run([sys.executable, "-c", CALLED], check=True)
