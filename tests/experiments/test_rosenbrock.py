"""Rosenbrock's valley: the counts are those of the calls, and a quick run gets to the bottom."""

import json

import jax
import jax.numpy as jnp
import numpy as np

from sigmapoint.experiments import EXPERIMENTS
from sigmapoint.experiments.rosenbrock import experiment
from sigmapoint.experiments.rosenbrock.searches import Log
from sigmapoint.problems import rosenbrock


def test_the_cost_is_rosenbrocks():
    x = jax.random.normal(jax.random.key(0), (20, 2))
    printed = 100 * (x[:, 1] - x[:, 0] ** 2) ** 2 + (1 - x[:, 0]) ** 2
    np.testing.assert_allclose(jax.vmap(rosenbrock.cost)(x), printed, rtol=1e-13)
    np.testing.assert_array_equal(rosenbrock.residual(jnp.ones(2)), 0.0)


def test_a_log_counts_what_is_called_until_the_target_is_seen():
    log = Log()
    value, derivative = log.noted(rosenbrock.residual), log.noted(rosenbrock.residual, derivative=True)
    value(np.zeros(2))
    derivative(np.ones(2))  # a derivative at the minimum has not seen its value
    value(np.zeros(2))
    derivative(np.zeros(2))
    assert np.isnan(log.search([np.zeros(2)]).values)
    value(np.ones(2))
    value(np.ones(2))
    search = log.search([np.zeros(2), np.ones(2)])
    assert (search.values, search.derivatives, search.iterations) == (3, 2, 1)


def test_a_quick_run_reaches_the_minimum_and_is_written(tmp_path):
    rows = EXPERIMENTS["rosenbrock"].run(None, 0, tmp_path, True)
    assert json.loads((tmp_path / "results.json").read_text()) == rows
    assert (tmp_path / "rosenbrock.png").exists()
    measured = {(row["quantity"], row["method"]): row["measured"] for row in rows}
    assert measured["f after 10 updates from (−1.2, 1)", experiment.UKF] < 1e-20
    for name in (experiment.UKF, "EKF", "Levenberg-Marquardt", "BFGS"):
        assert measured["values to f ≤ 1e-12 from (−1.2, 1)", name] < 500
