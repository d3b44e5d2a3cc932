"""The scalar experiment: the notes' code is reproduced, its claim holds, and what is written can be read back."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sigmapoint as sp
from sigmapoint.experiments import EXPERIMENTS
from sigmapoint.experiments.publishing.results import mean_of
from sigmapoint.experiments.scalar import experiment
from sigmapoint.problems import scalar

KEYS = ["experiment", "quantity", "method", "published", "measured", "spread", "runs", "note"]


def ekf_of_the_notes(z):
    """Section 6.2, line by line."""
    xhat, P, out = 2.0, 1.0, []
    for zk in z:
        A = 0.5 / np.sqrt(5 + xhat)
        xhat, P = np.sqrt(5 + xhat), A * P * A + 1
        C = 3 * xhat**2
        gain = P * C / (C * P * C + 2)
        xhat = max(-5.0, xhat + gain * (zk - xhat**3))
        P = (1 - gain * C) * P
        out.append((xhat, np.sqrt(P)))
    return np.array(out).T


def spkf_of_the_notes(z):
    """Section 6.6, line by line."""
    h2, L = 3.0, 3
    w = np.array([(h2 - L) / h2] + [1 / (2 * h2)] * (2 * L))
    xhat, P, out = 2.0, 1.0, []
    for zk in z:
        root = np.diag([np.sqrt(P), 1.0, np.sqrt(2.0)])
        X = np.array([xhat, 0, 0])[:, None] + np.sqrt(h2) * np.hstack([np.zeros((L, 1)), root, -root])
        Xx = np.sqrt(5 + X[0]) + X[1]
        Z = Xx**3 + X[2]
        xhat, zhat = w @ Xx, w @ Z
        P, Pxz, Pz = w @ (Xx - xhat) ** 2, w @ ((Xx - xhat) * (Z - zhat)), w @ (Z - zhat) ** 2
        xhat, P = xhat + Pxz / Pz * (zk - zhat), P - Pxz**2 / Pz
        out.append((xhat, np.sqrt(P)))
    return np.array(out).T


@pytest.fixture(scope="module")
def series():
    return experiment.series(experiment.QUICK_RUNS, seed=3)  # the shapes of the quick run: compiled once


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    out = tmp_path_factory.mktemp("scalar")
    return out, EXPERIMENTS["scalar"].run(None, 0, out, True)


def value(rows, quantity, method):
    (row,) = [r for r in rows if r["quantity"] == quantity and r["method"] == method]
    return row["measured"], row["spread"]


@pytest.mark.parametrize(
    ("name", "notes"), [("EKF", ekf_of_the_notes), (experiment.SPKF, spkf_of_the_notes)], ids=["ekf", "spkf"]
)
def test_with_the_early_prediction_the_filters_are_the_code_of_the_notes(series, name, notes):
    _, z = series
    mean, std = experiment.estimated(experiment.METHODS[name][0], z, early_prediction=1)
    for row in range(10):
        np.testing.assert_allclose([mean[row], std[row]], notes(np.asarray(z[row, :, 0])), rtol=1e-8)


def test_a_filter_at_the_end_of_the_root_stays_finite():
    model = scalar.model()
    slope = jax.jacfwd(lambda x: model.dynamics(x, None))(jnp.array([scalar.LOWEST]))
    assert np.isfinite(slope).all()
    y = jnp.full((5, 1), -1e4)
    for method in (sp.ekf(), sp.srcdkf(), experiment.METHODS[experiment.SPKF][0]):
        post = sp.filter(model, y, method=method)
        assert np.isfinite(post.mean).all()
        assert post.mean.min() >= scalar.LOWEST


def test_the_exact_posterior_is_calibrated(quick):
    _, rows = quick
    nees, spread = value(rows, "mean of error²/σ² (NEES)", "exact")
    assert abs(nees - 1) < 4 * spread


def test_the_exact_posterior_is_exact_where_the_answer_is_known():
    z = jnp.zeros((1, 1))  # p(x | z=0) ∝ exp(-(x-2)²/2 - x⁶/4), by quadrature
    x = np.linspace(-4, 4, 200_001)
    p = np.exp(-0.5 * (x - 2) ** 2 - x**6 / 4)
    mean, std = scalar.exact_posterior(z)
    m = (p @ x) / p.sum()
    np.testing.assert_allclose([mean[0, 0], std[0, 0]], [m, np.sqrt((p @ (x - m) ** 2) / p.sum())], rtol=1e-8)


def test_the_claim_of_the_notes_holds_by_far_more_than_chance(quick):
    _, rows = quick
    for method in (experiment.SPKF, "CDKF", "SR-CDKF", "UKF", "iterated SR-CDKF"):
        accuracy, a = value(rows, "RMSE, difference to the EKF", method)
        bounds, b = value(rows, f"{experiment.BOUNDS}, difference to the EKF", method)
        assert accuracy < -5 * a
        assert bounds > 5 * b
        assert value(rows, experiment.BOUNDS, method)[0] > 0.95


def test_two_cubature_points_know_nothing_of_curvature(quick):
    _, rows = quick
    worse, spread = value(rows, f"{experiment.BOUNDS}, difference to the EKF", "CKF")
    assert worse < -5 * spread


def test_no_method_beats_the_exact_posterior(series):
    x, z = series
    mean, _ = scalar.exact_posterior(z[..., 0])
    best = np.mean((np.asarray(mean) - x) ** 2, 1)
    for name in (experiment.SPKF, "iterated EKF", "iterated SR-CDKF"):
        excess = mean_of(np.mean((experiment.estimated(experiment.METHODS[name][0], z)[0] - x) ** 2, 1) - best)
        assert excess.value > -4 * excess.spread


def test_runs_that_are_lost_are_counted(series):
    x, _ = series
    mean, std = x + 0.1, np.ones_like(x)
    mean[3, 5], mean[4, 7] = np.nan, x[4, 7] + 100
    scores = experiment.score(x, mean, std)
    rows = experiment.absolute(dict.fromkeys([*experiment.METHODS, "exact"], scores))
    (row,) = [r for r in rows if r.quantity.startswith("divergent") and r.method == "EKF"]
    assert row.measured == 2
    assert row.note.startswith("1 not finite; largest error 100.")
    assert {r.runs for r in rows if r.quantity.startswith("RMSE")} == {len(x) - 1}


def test_a_quantity_and_a_method_name_one_row(quick):
    _, rows = quick
    assert len({(row["quantity"], row["method"]) for row in rows}) == len(rows)


def test_what_is_written_can_be_read(quick):
    out, rows = quick
    read = json.loads((out / "results.json").read_text())
    assert read == rows
    assert all(list(row) == KEYS and row["experiment"] == "scalar" for row in read)
    assert all(row["published"] is None for row in read)
    assert all(row["runs"] == experiment.QUICK_RUNS for row in read)
    page = (out / "report.html").read_text()
    assert page.count('src="data:image/png;base64,') == 2
    assert "http" not in page
    for name in ("scalar-run", "scalar-methods"):
        assert (out / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert "<svg" in (out / f"{name}.svg").read_text()
    claim = json.loads((out / "claim.json").read_text())
    assert set(claim) == {"title", "claim", "holds", "verdict", "pictures"}
    assert set(claim["pictures"]) == {p.name for p in out.glob("*.png")}
    assert f"<p>Claim: {claim['claim']}</p>" in page
    assert len(list(out.iterdir())) == 7


def test_one_run_is_refused(tmp_path):
    with pytest.raises(ValueError, match="runs must be at least 2"):
        EXPERIMENTS["scalar"].run(1, 0, tmp_path, True)


def test_every_experiment_says_what_it_is():
    for name, one in EXPERIMENTS.items():
        assert one.name == name
        assert one.description
        assert "\n" not in one.description
