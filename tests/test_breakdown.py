"""Estimates that are no numbers are warned of, whatever was measured: to whoever called, and of which series."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sigmapoint as sp
from sigmapoint.breakdown import BreakdownWarning

ONE = np.eye(1)
GAP = np.array([[1.0], [np.nan], [np.nan], [np.nan]])
"""broken where nothing is measured any more"""


def model(dynamics, observation=lambda x, u: x):
    return sp.StateSpaceModel(dynamics, observation, ONE, ONE, sp.Gaussian(np.zeros(1), ONE))


BROKEN = model(lambda x, u: jnp.sqrt(x - 5.0))
SOUND = model(lambda x, u: x)
HALF_BROKEN = model(lambda x, u: jnp.sqrt(u) * x)
"""by its input"""


ESTIMATES, LIKELIHOOD = "estimates are not finite", "log-likelihood is not finite"


def lost(what):
    return pytest.warns(BreakdownWarning, match=f"the {what}")


@pytest.mark.parametrize("run", [sp.filter, sp.smooth])
def test_a_model_that_gives_nan(run):
    with lost(LIKELIHOOD):
        run(BROKEN, np.ones((4, 1)))


@pytest.mark.parametrize(
    ("run", "method"),
    [(sp.filter, sp.ekf()), (sp.filter, sp.srcdkf()), (sp.filter, sp.bootstrap(20)), (sp.smooth, sp.srcdkf())],
    ids=["ekf", "srcdkf", "bootstrap", "smoothed"],
)
def test_a_model_that_gives_nan_where_nothing_is_measured(run, method):
    with lost(ESTIMATES):
        run(BROKEN, GAP, method=method, key=0)


def test_a_likelihood_that_is_infinite():
    with lost(LIKELIHOOD):
        sp.filter(model(lambda x, u: x, lambda x, u: x + 1e200), np.ones((4, 1)))


def test_of_what_was_not_kept_nothing_is_said():
    assert sp.filter(BROKEN, GAP, keep=()).mean is None
    with lost(ESTIMATES):
        sp.filter(BROKEN, GAP, keep=("std",))


@pytest.mark.parametrize("together", [np.array, list], ids=["array", "list"])
@pytest.mark.parametrize(("y", "what"), [(np.ones((4, 1)), LIKELIHOOD), (GAP, ESTIMATES)])
def test_the_series_is_named(together, y, what):
    with lost(f"{what} of series 1:"):
        sp.batch(HALF_BROKEN, together([y, y]), together([np.ones(4), -np.ones(4)]))


def test_particles_that_explain_nothing_are_named_with_their_series():
    y = np.array([[0.0], [1e200]])
    far = pytest.warns(BreakdownWarning, match="no particle explains the measurement of row 1 of series 1:")
    with far:
        sp.batch(SOUND, [y[:1], y], method=sp.bootstrap(10), key=0)
    with far:
        sp.batch(SOUND, np.stack([0 * y, y]), method=sp.bootstrap(10), key=0)


def test_particles_of_which_some_are_lost_for_a_while():
    """Where they stray past 1 in a gap, the mean is no number; the next measurement leaves them out."""
    model = sp.StateSpaceModel(
        lambda x, u: jnp.where(x > 1, jnp.nan, x), lambda x, u: x, ONE, 0.1 * ONE, sp.Gaussian(np.zeros(1), 0.01 * ONE)
    )
    with pytest.warns(BreakdownWarning):
        post = sp.filter(model, np.array([[0.0], [np.nan], [np.nan], [-1.0]]), method=sp.bootstrap(200), key=0)
    assert np.isnan(post.mean[2, 0])


def test_nothing_is_said_inside_a_transformation_nor_of_a_sound_result():
    assert np.isnan(jax.jit(lambda y: sp.filter(BROKEN, y).log_likelihood)(np.ones((4, 1))))
    assert np.isnan(jax.vmap(lambda y: sp.filter(BROKEN, y).log_likelihood)(np.ones((2, 4, 1)))).all()
    assert sp.filter(SOUND, np.ones((4, 1))).breakdown() is None


def test_dual_estimation_warns_too():
    run = sp.dual(lambda a: model(lambda x, u: jnp.sqrt(a * x - 5.0)), sp.real(0.9, std=0.1))
    with lost(LIKELIHOOD):
        run.filter(np.ones((4, 1)))


@pytest.mark.parametrize("measured", [1, 40])
def test_a_diagnosis_counts_what_was_lost_and_says_nothing_good(measured):
    y = np.full((60, 1), np.nan)
    y[:measured] = 1.0
    failing = model(lambda x, u: jnp.where(u > 50, jnp.nan, x))
    with lost(ESTIMATES):
        found = sp.diagnose(sp.filter(failing, y, np.arange(60.0)), truth=np.ones((60, 1)))
    assert found.lost == 8
    assert "The filter broke down: 8 sample(s) have no finite estimate" in str(found)
    assert "good" not in {verdict.severity for verdict in found.verdicts}


def test_a_comparison_says_it_in_its_notes():
    rows = sp.compare(BROKEN, GAP, methods={"ekf": sp.ekf(), "bootstrap": sp.bootstrap(20)}, key=0).rows
    assert [row["note"] for row in rows] == ["not finite from row 1", "not finite from row 1"]


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
