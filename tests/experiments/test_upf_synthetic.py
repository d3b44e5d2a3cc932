"""The synthetic experiment of particle filters: Table 7.1 with its floor, and without."""

import json

import jax.numpy as jnp
import numpy as np
import pytest

import sigmapoint as sp
from sigmapoint.experiments import EXPERIMENTS
from sigmapoint.experiments.floored import floored
from sigmapoint.experiments.upf_synthetic import experiment as upf_synthetic
from sigmapoint.experiments.upf_synthetic import runs as upf_synthetic_runs

FIGURES = ("upf-synthetic-run", "upf-synthetic-scores")
PUBLISHED, LOGARITHMS, TOLD = (f"RMSE, mean over runs, {case.name}" for case in upf_synthetic_runs.cases())


def scores(rows):
    return {(row["quantity"], row["method"]): (row["measured"], row["spread"]) for row in rows}


def near(measured, spread, published):
    """By three standard errors and a tenth."""
    return abs(measured - published) < 3 * spread + 0.1 * published


def test_a_floor_is_felt_far_from_the_measurement_only():
    values = jnp.array([0.0, 0.003, 1.0])
    noise = sp.Additive(1e-5 * jnp.eye(1))
    exact, with_floor = (floored(noise, least).distribution.log_prob(values[:, None]) for least in (0.0, 1e-99))
    np.testing.assert_allclose(exact, -0.5 * values**2 / 1e-5 - 0.5 * np.log(2 * np.pi * 1e-5), rtol=1e-12)
    np.testing.assert_allclose(with_floor[:2], exact[:2], rtol=1e-12)
    np.testing.assert_allclose(with_floor[2], np.log(1e-99), rtol=1e-12)


def test_the_variance_over_runs_is_that_of_the_table():
    found = upf_synthetic.spread_of(np.array([1.0, 2.0, 4.0]))
    np.testing.assert_allclose(found.value, np.var([1.0, 2.0, 4.0], ddof=1), rtol=1e-12)


def test_a_quick_run_shows_what_the_floor_does(tmp_path):
    rows = EXPERIMENTS["upf-synthetic"].run(None, 0, tmp_path, True)
    assert json.loads((tmp_path / "results.json").read_text()) == rows
    assert all((tmp_path / f"{figure}.png").exists() for figure in FIGURES)
    score = scores(rows)
    for name in ("EKF", "UKF", "PF", "UPF"):
        assert near(*score[PUBLISHED, name], upf_synthetic.PUBLISHED[name][0])
    assert score[PUBLISHED, "UPF"][0] < 0.5 * score[PUBLISHED, "PF"][0]
    assert score[LOGARITHMS, "PF"][0] < 0.5 * score[PUBLISHED, "PF"][0]
    least = score["by solving y = h(x) for x > 0", "no filter"][0]
    assert score[LOGARITHMS, "iterated EKF"][0] == pytest.approx(least, rel=0.02)


@pytest.mark.slow
def test_the_whole_table_is_reproduced(tmp_path):
    score = scores(EXPERIMENTS["upf-synthetic"].run(None, 0, tmp_path, False))
    for name, (mean, variance) in upf_synthetic.PUBLISHED.items():
        assert near(*score[PUBLISHED, name], mean)
        assert near(*score[PUBLISHED.replace("mean", "variance"), name], variance)
    assert near(*score[LOGARITHMS, "PF, Gaussian draws"], 0.404)  # of another implementation
    for name, (low, high) in {"EKF": (0.06, 0.1), "PF": (0.03, 0.06), "PF, guided": (0, 0.006)}.items():
        assert low < score[TOLD, name][0] < high
