"""Terrain-aided navigation: what is scored, and that particles keep what a Gaussian filter loses."""

import json

import jax
import jax.numpy as jnp
import numpy as np
from scipy.stats import norm

import sigmapoint as sp
from sigmapoint.experiments import EXPERIMENTS
from sigmapoint.experiments.terrain import runs as terrain_runs
from sigmapoint.experiments.terrain.runs import KERNEL, Belief, Flights

FIGURES = ("terrain-ridge", "terrain-errors")


def test_a_belief_is_the_density_of_its_mixture():
    belief = Belief(np.array([[0.0, 100.0]]), np.log([[0.25, 0.75]]), np.array([[30.0]]))
    expected = 0.25 * norm.pdf(40.0, 0.0, 30.0) + 0.75 * norm.pdf(40.0, 100.0, 30.0)
    np.testing.assert_allclose(belief.log_density(np.array([40.0])), [np.log(expected)], rtol=1e-12)


def test_particles_and_a_gaussian_of_one_belief_score_the_same():
    y = jnp.full((1, 1), jnp.nan)
    keys = jax.random.split(jax.random.key(0))
    gaussian, particles = (terrain_runs.belief_of(method, y, keys[0]) for method in (sp.ekf(), sp.bootstrap(20_000)))
    at = np.array([1000.0])
    np.testing.assert_allclose(gaussian.log_density(at), np.log(norm.pdf(1000.0, 0.0, np.hypot(2000.0, KERNEL))))
    # Of 20,000 particles 176 are within a kernel, 2 √π KERNEL wide: 8 % of a density, by one standard error.
    np.testing.assert_allclose(particles.log_density(at), gaussian.log_density(at), atol=0.25)


def test_no_belief_is_worth_less_than_a_share_of_dead_reckoning():
    y = jnp.zeros((1, terrain_runs.terrain.STEPS, 1)) + 400.0
    x = jnp.zeros((1, terrain_runs.terrain.STEPS, 2))  # an aircraft that stands still, to the surprise of the filter
    found = terrain_runs.found(sp.ekf(), Flights(x, y), jax.random.key(0))
    least = np.log(terrain_runs.DOUBT) + terrain_runs.dead_reckoning().log_density(np.zeros(found.log_density.shape[1]))
    assert (found.log_density >= least[None] - 1e-9).all()
    assert found.log_density[0, -1] < least[-1] + 1e-3
    assert found.lost == 1


def test_a_quick_run_shows_what_particles_keep(tmp_path):
    rows = EXPERIMENTS["terrain"].run(None, 0, tmp_path, True)
    assert json.loads((tmp_path / "results.json").read_text()) == rows
    assert all((tmp_path / f"{figure}.png").exists() for figure in FIGURES)
    lost = {row["method"]: row["measured"] for row in rows if row["quantity"].startswith("share of flights lost")}
    density = {row["method"]: row["measured"] for row in rows if row["quantity"].startswith("logarithm of the density")
               and "minus" not in row["quantity"]}  # fmt: skip
    assert lost["bootstrap"] <= 0.2 < lost["UKF"]
    assert density["UKF"] < density["bootstrap"] < density["reference"] + 0.5
