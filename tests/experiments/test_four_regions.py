"""The four regions: their geometry, and that every method learns them."""

import json

import jax
import jax.numpy as jnp
import numpy as np

from sigmapoint.experiments import EXPERIMENTS
from sigmapoint.experiments.learning import four_regions as experiment
from sigmapoint.problems import four_regions


def test_areas_are_those_of_circles_and_halves():
    disc, _, outer = (np.pi * r**2 for r in four_regions.RADII)
    beyond = (4 - outer) / 2
    crossed = (outer - disc) / 2
    areas = np.array([beyond, beyond, crossed + disc, crossed]) / 4
    np.testing.assert_allclose(areas, [0.228, 0.228, 0.284, 0.261], atol=1e-3)
    _, labels = four_regions.grid(1000)
    np.testing.assert_allclose(np.bincount(labels, minlength=4) / 1e6, areas, atol=1e-4)
    _, labels = four_regions.drawn(20_000, jax.random.key(0))
    np.testing.assert_allclose(np.bincount(labels, minlength=4) / 20_000, areas, atol=4 * 0.5 / 20_000**0.5)


def test_regions_interlock():
    above, beside = jnp.array([[0.0, 0.9], [0.0, -0.9]]), jnp.array([[0.7, 0.1], [0.3, 0.1], [0.1, 0.1]])
    assert four_regions.region(above).tolist() == [0, 1]
    assert four_regions.region(beside).tolist() == [2, 3, 2]
    assert four_regions.region(beside * jnp.array([[-1.0, 1.0]])).tolist() == [3, 2, 2]


def test_the_grid_runs_row_by_row_from_below():
    x, _ = four_regions.grid(4)
    np.testing.assert_allclose(x[:2], [[-0.75, -0.75], [-0.25, -0.75]])
    np.testing.assert_allclose(x.mean(0), 0.0, atol=1e-12)


def test_targets_name_the_region():
    np.testing.assert_allclose(four_regions.targets(jnp.array([2])), [[-0.8, -0.8, 0.8, -0.8]])


def test_a_quick_run_learns_and_is_written(tmp_path):
    rows = EXPERIMENTS["four-regions"].run(None, 0, tmp_path, True)
    assert json.loads((tmp_path / "results.json").read_text()) == rows
    for name in ("wrong", "costs", "squares", "maps"):
        assert (tmp_path / f"four-regions-{name}.png").exists()
    measured = {(row["quantity"], row["method"]): row["measured"] for row in rows}
    for name in experiment.QUICK:
        assert measured["share of the grid told right, last epoch", name] > 0.45
    assert measured["largest difference between dense and square root, relative, first epoch", "SR-UKF"] < 1e-3


def test_a_perfect_fit_has_finite_derivatives():
    one = experiment.learner("EKF, cross-entropy")
    inputs, _ = one.setup.checked(jnp.zeros((1, 2)), jnp.array([0]))
    for own in (0.0, 40.0, 1000.0, 5000.0, -5000.0):  # of its logit, a bias of the last layer
        w = one.setup.parameters.start.at[-4].set(own)
        value, slope = jax.value_and_grad(lambda w: one.setup.values(w, inputs).sum())(w)
        assert jnp.isfinite(value), own
        assert jnp.isfinite(slope).all(), own
    np.testing.assert_allclose(value, (2 * 5000.0) ** 0.5, rtol=1e-2)
