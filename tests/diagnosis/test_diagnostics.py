"""Diagnoses say what is true of filters made consistent, overconfident, underconfident, and wrong in known ways."""

import warnings
from dataclasses import fields

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from diagnosis.made import M, S, T, made, said
from scipy import stats

import sigmapoint as sp
from sigmapoint.diagnosis.consistency import consistency, normalised, row_band
from sigmapoint.diagnosis.diagnostics import diagnose
from sigmapoint.diagnosis.whiteness import LAGS, autocorrelation, quantiles
from sigmapoint.results import Posterior, input_columns


def test_normalised_squares_are_those_of_the_inverse(white):
    holes = white.copy()
    holes[::3, 1] = np.nan
    found = normalised(holes, np.broadcast_to(S, (T, M, M)))
    whole = np.einsum("ti,ij,tj->t", white, np.linalg.inv(S), white)
    single = white[:, 0] ** 2 / S[0, 0]
    partial = np.arange(T) % 3 == 0
    np.testing.assert_allclose(found.squared, np.where(partial, single, whole), rtol=1e-12)
    np.testing.assert_array_equal(found.degrees, np.where(partial, 1, 2))
    np.testing.assert_array_equal(np.isnan(found.white), np.isnan(holes))


def test_normalised_vectors_have_the_identity_as_covariance(white):
    z = normalised(white, np.broadcast_to(S, (T, M, M))).white
    np.testing.assert_allclose(z.T @ z / T, np.eye(M), atol=5 * (2 / T) ** 0.5)  # 5 σ of a sample variance


def test_directions_without_variance_lower_the_degrees_of_freedom():
    singular = np.array([[[1.0, 1.0], [1.0, 1.0]], [[0.0, 0.0], [0.0, 4.0]], [[0.0, 0.0], [0.0, 0.0]]])
    found = normalised(np.array([[1.0, 1.0], [9.0, 2.0], [1.0, 1.0]]), singular)
    np.testing.assert_array_equal(found.degrees, [1, 1, 0])
    np.testing.assert_allclose(found.squared, [1.0, 1.0, 0.0], atol=1e-12)


def test_bands_are_the_quantiles_of_chi_squared():
    degrees = np.array([0, 1, 3])
    low, high = row_band(degrees)
    np.testing.assert_allclose(low, [np.nan, *stats.chi2.ppf(0.025, [1, 3])])
    np.testing.assert_allclose(high, [np.nan, *stats.chi2.ppf(0.975, [1, 3])])
    found = consistency(np.array([5.0, 1.0, 3.0]), degrees)
    assert (found.mean, found.rows, found.degrees) == (1.0, 2, 4)
    np.testing.assert_allclose(found.band, stats.chi2.ppf([0.025, 0.975], 4) / 4)


def test_mean_nis_of_consistent_filters_is_within_its_band_95_percent_of_the_time():
    rng, runs = np.random.default_rng(1), 400
    squared = rng.chisquare(2, (runs, 200))
    found = [consistency(row, np.full(200, 2)) for row in squared]
    hits = sum(c.band[0] <= c.mean <= c.band[1] for c in found)
    assert abs(hits / runs - 0.95) < 4 * (0.95 * 0.05 / runs) ** 0.5
    inside = np.mean([c.inside for c in found])
    assert abs(inside - 0.95) < 4 * (0.95 * 0.05 / squared.size) ** 0.5


def test_a_consistent_filter_gets_only_good_verdicts(white):
    found = diagnose(made(white, u={"current": jnp.asarray(np.random.default_rng(2).normal(size=T))}))
    assert {v.severity for v in found.verdicts} == {"good"}
    assert found.nis.band[0] < found.nis.mean < found.nis.band[1]
    assert said(found, "The error bars fit the innovations")


@pytest.mark.parametrize(
    ("scale", "severity", "words"),
    [
        (3.0**0.5, "bad", "overconfident about the measurements: its innovations are on average"),
        (1.5**0.5, "warning", "larger observation_noise or process_noise, or add the missing state"),
        (0.5, "warning", "underconfident about the measurements"),
        (0.5, "warning", "Try a smaller observation_noise or process_noise"),
    ],
)
def test_wrong_error_bars_are_named_with_what_to_try(white, scale, severity, words):
    found = diagnose(made(white, scale))
    assert abs(found.nis.mean - scale**2) < 5 * scale**2 * (2 / (M * T)) ** 0.5
    (verdict,) = said(found, words)
    assert verdict.severity == severity


def test_what_is_outside_the_band_but_too_little_to_matter_says_so(white):
    (verdict,) = said(diagnose(made(white, 1.17**0.5)), "The error bars fit the innovations")
    assert verdict.severity == "good"
    assert "(slightly outside, too little to matter)" in verdict.text
    assert not said(diagnose(made(white)), "slightly outside")


def test_a_few_outliers_are_not_called_a_wrong_noise(white):
    hit = white.copy()
    hit[::100] *= 20
    found = diagnose(made(hit))
    assert said(found, "look for outliers")
    assert said(found, "heavier tails")


def test_correlation_in_time_is_named_with_its_direction(white):
    slow = white.copy()
    for k in range(1, T):
        slow[k] = 0.7 * slow[k - 1] + 0.51**0.5 * white[k]
    found = diagnose(made(slow))
    assert [v.severity for v in said(found, "something slow is not modelled")] == ["bad", "bad"]
    rho = found.elements[0].autocorrelation
    assert rho.shape == (LAGS,)
    assert abs(rho[0] - 0.7) < 0.06  # 5 σ: √((1 - 0.49) / T) = 0.011
    swinging = white[1:] - 0.5 * white[:-1]
    assert said(diagnose(made(swinging)), "the filter overreacts")


def test_ljung_box_agrees_with_its_formula_and_its_distribution():
    rng = np.random.default_rng(3)
    z = rng.normal(size=500)
    rho, pairs = autocorrelation(z, LAGS)
    textbook = np.array([(z - z.mean())[:-k] @ (z - z.mean())[k:] for k in range(1, LAGS + 1)]) / (500 * z.var())
    np.testing.assert_allclose(rho * pairs / 500, textbook, rtol=1e-10)
    Q = 500 * 502 * np.sum(textbook**2 / (500 - np.arange(1, LAGS + 1)))
    np.testing.assert_allclose(502 / 500 * pairs @ rho**2, Q, rtol=1e-10)


def test_the_band_of_a_lag_is_as_wide_as_its_pairs_are_few():
    rng, beyond, lags, called = np.random.default_rng(8), 0, 0, 0
    for _ in range(50):
        z = np.where(rng.random((300, 2)) < 0.25, rng.normal(size=(300, 2)), np.nan)
        found = diagnose(made(z, cov=np.eye(2)))
        called += len(said(found, "correlated in time ("))
        for e in found.elements:
            rho, pairs = autocorrelation(e.white, e.band.size)
            np.testing.assert_allclose(e.band, 1.96 / np.sqrt(pairs))
            beyond, lags = beyond + (np.abs(rho) > e.band).sum(), lags + rho.size
    assert abs(beyond / lags - 0.05) < 5 * (0.05 * 0.95 / lags) ** 0.5
    assert called <= 1  # of 100, at a level of 0.001


def test_lags_that_no_two_values_are_apart_say_nothing():
    rng = np.random.default_rng(9)
    z = np.full((400, 2), np.nan)
    z[::4] = rng.normal(size=(100, 2))
    e = diagnose(made(z, cov=np.eye(2))).elements[0]
    np.testing.assert_array_equal(np.isfinite(e.band), np.arange(1, LAGS + 1) % 4 == 0)


def test_an_input_that_innovations_follow_is_named(white):
    current = np.random.default_rng(4).normal(size=T)
    follows = white + np.outer(np.roll(current, 1), [0.4, 0.0])
    found = diagnose(made(follows, u={"current": jnp.asarray(current), "gear": jnp.arange(T) % 5}))
    (verdict,) = said(found, "The effect of input current on p is not fully modelled")
    assert verdict.severity == "warning"


def test_two_slow_series_are_not_taken_for_related():
    rng, alarms = np.random.default_rng(5), 0
    for _ in range(20):
        walk = np.cumsum(rng.normal(size=(300, 2)) * 0.1, axis=0)
        slow = np.stack([np.convolve(rng.normal(size=300), np.ones(15) / 15**0.5, "same") for _ in range(2)], 1)
        alarms += len(said(diagnose(made(slow, u=jnp.asarray(walk), cov=np.eye(2))), "effect of input"))
    assert alarms <= 15  # of 40; about 30 with the band for white series


def test_an_offset_is_named(white):
    (verdict,) = said(diagnose(made(white + np.array([0.0, 0.5]))), "Innovations of q are")
    assert "standard deviations off zero" in verdict.text


@pytest.mark.parametrize("name", ["innovation", "innovation_cov", "nis", "mean", "cov", "std"])
def test_a_field_that_was_not_kept_is_named(white, name):
    values = {f.name: getattr(made(white), f.name) for f in fields(Posterior)} | {name: None}
    with pytest.raises(ValueError, match=rf"no {name}: call sp.filter with keep=\('{name}'"):
        diagnose(Posterior(**values), truth=np.zeros((T, 2)))


def test_a_batch_and_a_truth_of_another_shape_are_refused(white):
    batch = jax.tree.map(lambda a: a[None], made(white))
    with pytest.raises(ValueError, match="batch of shape"):
        diagnose(batch)
    with pytest.raises(ValueError, match="truth must have the shape"):
        diagnose(made(white), truth=np.zeros((T, 3)))


@pytest.mark.parametrize(
    ("innovation", "cov", "words"),
    [
        (np.ones((1, 2)), S, "Only 1 sample"),
        (np.full((50, 2), np.nan), S, "No usable measurement"),
        (np.zeros((50, 2)), S, "underconfident"),
        (np.ones((50, 2)), np.zeros((2, 2)), "No usable measurement"),
        (np.full((50, 2), 0.9), S, "off zero on average"),
    ],
)
def test_degenerate_series_pass_without_warnings(innovation, cov, words):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = diagnose(made(innovation, u=jnp.ones(len(innovation)), cov=cov))
    assert said(found, words)


def test_a_filter_that_broke_down_is_told_from_missing_measurements(white):
    post = made(white)
    values = {f.name: getattr(post, f.name) for f in fields(Posterior)}
    values["innovation"] = post.innovation.at[100:].set(jnp.nan)
    found = diagnose(Posterior(**values))
    assert found.lost == T - 100
    assert found.verdicts[0].severity == "bad"
    assert "broke down" in found.verdicts[0].text
    assert "good" not in {v.severity for v in found.verdicts}  # the few that are left say nothing


def test_input_columns_are_named_by_where_they_are():
    u = {"current": np.ones(3), "wheel": {"left": np.ones((3, 2))}, "scalar": np.ones(4), "text": None}
    assert list(input_columns(u, 3)) == ["current", "wheel.left0", "wheel.left1"]
    assert list(input_columns(np.ones((3, 2)), 3)) == ["u0", "u1"]
    assert input_columns(None, 3) == {}


def test_an_innovation_of_fewer_elements_than_the_measurement_has_its_own_name(unit_vector):
    found = diagnose(sp.filter(*unit_vector(400)))
    assert [element.name for element in found.elements] == ["e0"]
    assert {v.severity for v in found.verdicts} == {"good"}


def test_quantiles_keep_both_tails():
    z = np.random.default_rng(7).normal(size=10_000)
    at, values = quantiles(z)
    assert at.size <= 400
    assert (values[0], values[-1]) == (z.min(), z.max())


def test_a_partly_missing_row_on_a_manifold_was_not_measured(unit_vector):
    model, y = unit_vector(400)
    post = sp.filter(model, y.at[20, 0].set(jnp.nan))
    found = diagnose(post)
    assert found.lost == 0
    assert {v.severity for v in found.verdicts} == {"good"}
    assert np.isnan(post.to_frame()["nis"][20])


def test_print_shows_the_verdicts_alone_the_gravest_first(white):
    lines = str(diagnose(made(white, 3.0**0.5))).splitlines()
    assert lines[0].startswith("bad      The filter is overconfident")
    assert lines[-1].startswith("good     ")
    assert max(map(len, lines)) <= 120
    assert len(lines) < 10


def test_an_angle_that_grows_past_what_its_points_have_room_for_is_named():
    model = sp.StateSpaceModel(
        lambda x, u: x + jnp.stack([0.1 * x[1], 0.0 * x[0]]),
        lambda x, u: x[:1],
        jnp.diag(jnp.array([0.05, 1e-4])),
        0.01 * jnp.eye(1),
        sp.Gaussian(jnp.zeros(2), 0.01 * jnp.eye(2)),
        state_space=sp.angles(0),
        observation_space=sp.angles(0),
        state_names=("heading", "rate"),
    )
    _, y = sp.simulate(model, 200, key=jax.random.key(0))
    assert not diagnose(sp.filter(model, y)).wide
    found = diagnose(sp.filter(model, y.at[50:150].set(jnp.nan)))
    assert list(found.wide) == ["heading"]
    assert found.wide["heading"] > np.pi / 2
    (verdict,) = said(found, "sigma points fold")
    assert verdict.severity == "warning"
    assert "heading (up to" in verdict.text
