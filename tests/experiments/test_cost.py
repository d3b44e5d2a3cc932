"""The count of operations against closed forms, and that the experiment runs."""

import jax
import jax.numpy as jnp
import pytest

from sigmapoint.experiments import EXPERIMENTS
from sigmapoint.experiments.cost.operations import operations


def test_products_and_factors_count_as_in_the_textbook():
    A, B = jnp.ones((30, 20)), jnp.ones((20, 10))
    assert operations(lambda A, B: A @ B, A, B) == pytest.approx(2 * 30 * 20 * 10, rel=0.01)
    factored = operations(jax.lax.linalg.cholesky, jnp.eye(60))
    assert factored == pytest.approx(60**3 / 3, rel=0.3)  # a few passes over the matrix besides
    assert operations(lambda A: A + 1, A) == 600


def test_a_loop_counts_as_often_as_it_runs():
    def looped(x):
        return jax.lax.fori_loop(0, 7, lambda i, x: jax.jit(lambda x: x * 2.0)(x), x)

    assert operations(looped, jnp.ones(5)) == pytest.approx(35, abs=14)  # and a counter
    # The cheaper branch, and one for the predicate.
    assert operations(lambda p, x: jax.lax.cond(p, lambda x: x + 1, lambda x: x * 2 + 1, x), True, jnp.ones(5)) == 6


def test_a_loop_that_ends_by_its_data_is_refused():
    with pytest.raises(NotImplementedError):
        operations(lambda x: jax.lax.while_loop(lambda x: x < 9, lambda x: x + 1, x), 1.0)


def test_a_quick_run_shows_the_orders(tmp_path):
    rows = EXPERIMENTS["cost"].run(None, 0, tmp_path, True)
    measured = {(row["quantity"], row["method"]): row["measured"] for row in rows}
    assert measured["exponent of operations against L", "SR-UKF"] < 2.1
    assert (tmp_path / "cost.png").exists()
