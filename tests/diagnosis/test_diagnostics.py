"""Diagnoses say what is true of filters made consistent, overconfident, underconfident, and wrong in known ways."""

import dataclasses
import warnings
from dataclasses import fields

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import signal, stats

import sigmapoint as sp
from sigmapoint.diagnosis.accuracy import errors
from sigmapoint.diagnosis.consistency import consistency, independent_rows, normalised, row_band
from sigmapoint.diagnosis.diagnostics import diagnose
from sigmapoint.diagnosis.verdict import gravest_first
from sigmapoint.diagnosis.whiteness import LAGS, autocorrelation, quantiles
from sigmapoint.results import Labels, Posterior, input_columns

T, M = 4000, 2
LABELS = Labels(("a", "b"), ("m", "1"), ("p", "q"), ("V", ""))
S = np.array([[2.0, 0.6], [0.6, 0.5]])


def made(innovation, scale=1.0, u=None, cov=S):
    """A result with these innovations, of a filter that thinks their covariance is `cov`."""
    innovation = np.asarray(innovation) * scale
    n = len(innovation)
    full = np.broadcast_to(cov, (n, *cov.shape))
    nis = normalised(innovation, full).squared
    eye = jnp.broadcast_to(jnp.eye(2), (n, 2, 2))
    return Posterior(
        mean=jnp.zeros((n, 2)),
        cov=eye,
        std=jnp.ones((n, 2)),
        innovation=jnp.asarray(innovation),
        innovation_cov=jnp.asarray(full),
        nis=jnp.asarray(nis),
        log_likelihood=jnp.asarray(0.0),
        y=jnp.asarray(innovation),
        u=u,
        labels=LABELS,
    )


@pytest.fixture(scope="module")
def white():
    return np.random.default_rng(0).multivariate_normal(np.zeros(M), S, T)


def said(found, word):
    return [v for v in found.verdicts if word in v.text]


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


def test_with_truth_errors_are_judged_too(white):
    truth = np.random.default_rng(6).normal(size=(T, 2))
    found = diagnose(made(white), truth)
    assert said(found, "The error bars fit the errors")
    sigma = (0.95 * 0.05 / T) ** 0.5
    assert abs(found.coverage[0].within[1] - 0.9545) < 5 * sigma
    assert abs(found.coverage[1].rms - 1) < 5 * (0.5 / T) ** 0.5
    worse = diagnose(made(white), 3 * truth)
    assert said(worse, "overconfident about the states")
    assert said(worse, "misses the truth too often")
    assert not said(worse, "not a matter of noise levels")
    both = diagnose(made(white, 0.5), 3 * truth)
    first = gravest_first(both.verdicts)[0]
    assert "not a matter of noise levels" in first.text
    assert said(both, "Try a smaller")
    assert said(both, "Try a larger")
    partly = truth.copy()
    partly[:, 1] = np.nan
    assert diagnose(made(white), partly).nees.degrees == T


def test_rows_of_an_autoregression_are_worth_what_its_correlations_say():
    T, noise = 200_000, np.random.default_rng(0).normal(size=200_000)
    for rho in (0.0, 0.5, -0.9):
        series = signal.lfilter([1.0], [1.0, -rho], noise)
        expected = T * (1 - rho**2) / (1 + rho**2)
        np.testing.assert_allclose(independent_rows(3 * series[:, None]), expected, rtol=0.1)
        np.testing.assert_allclose(independent_rows(np.stack([series, noise], 1)), 2 / (1 / T + 1 / expected), rtol=0.1)
    assert independent_rows(np.zeros((3, 1))) == 3.0
    assert independent_rows(np.ones((1, 2))) == 1.0


def test_independent_errors_beyond_their_bars_are_told_however_much(white):
    truth = 1.2 * np.random.default_rng(6).normal(size=(T, 2))
    assert said(diagnose(made(white), truth), "overconfident about the states")


def test_errors_that_stay_are_no_false_alarm_and_too_narrow_bars_are_told():
    """A level that moves slowly against a noisy sensor: its errors are correlated over dozens of rows."""
    model = sp.StateSpaceModel(
        lambda x, u: 0.999 * x,
        lambda x, u: x,
        1e-5 * jnp.eye(1),
        2.5e-3 * jnp.eye(1),
        sp.Gaussian(jnp.ones(1), 0.01 * jnp.eye(1)),
    )
    x, y = jax.vmap(lambda key: sp.simulate(model, 300, key=key))(jax.random.split(jax.random.key(0), 40))
    posts = [sp.filter(model, one) for one in y]
    found = [diagnose(post, true) for post, true in zip(posts, x)]
    outside = [not d.nees.band[0] <= d.nees.mean <= d.nees.band[1] for d in found]
    assert sum(outside) <= 6  # 2 of 40 expected
    sure = dataclasses.replace(posts[0], cov=posts[0].cov / 6)
    assert said(diagnose(sure, x[0]), "overconfident about the states")


def test_a_constant_whose_error_stays_is_no_false_alarm():
    """With the right filter of a constant, the last errors are all about the same one."""
    one = jnp.eye(1)
    model = sp.StateSpaceModel(lambda x, u: x, lambda x, u: x, 0 * one, one, sp.Gaussian(jnp.zeros(1), one))
    x, y = jax.vmap(lambda key: sp.simulate(model, 300, key=key))(jax.random.split(jax.random.key(1), 40))
    verdicts = [diagnose(sp.filter(model, *one[:1]), one[1]) for one in zip(y, x)]
    assert not any(said(found, "misses the truth") for found in verdicts)
    assert sum(bool(said(found, "overconfident about the states")) for found in verdicts) <= 6  # 2 of 40 expected
    assert sum(bool(said(found, "no surprise here")) for found in verdicts) > 0


def test_a_bias_within_two_standard_deviations_is_not_called_good_without_a_word(white):
    truth = np.full((T, 2), 1.5)
    (verdict,) = said(diagnose(made(white), truth), "Every ±2σ band")
    assert "as a bias does and noise does not" in verdict.text
    assert "(a 0 %, b 0 %)" in verdict.text


def test_an_estimate_that_is_not_finite_is_an_error_that_no_bar_covers(white):
    post = made(white)
    post = dataclasses.replace(post, mean=post.mean.at[: T // 2, 0].set(jnp.nan))
    first, second = errors(post, np.zeros((T, 2))).each()
    assert np.isnan(first.rms)
    assert first.within[2] == 0.5
    assert (second.rms, second.within[0], second.samples) == (0.0, 1.0, T)


def test_errors_of_angles_are_taken_the_short_way_round(white):
    turned = np.full((T, 2), 2 * np.pi)
    post = made(white)
    post = dataclasses.replace(post, labels=dataclasses.replace(post.labels, state_space=sp.angles(0, 1)))
    assert diagnose(post, turned).coverage[0].rms < 1e-12


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
