"""Errors against the truth: NEES and coverage, by how many errors are independent."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from diagnosis.made import T, made, said
from scipy import signal

import sigmapoint as sp
from sigmapoint.diagnosis.accuracy import errors
from sigmapoint.diagnosis.consistency import independent_rows
from sigmapoint.diagnosis.diagnostics import diagnose
from sigmapoint.diagnosis.verdict import gravest_first


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


def autoregression(rho, rows, seed=0):
    """Of variance one."""
    noise = np.random.default_rng(seed).normal(size=rows)
    return signal.lfilter([(1 - rho**2) ** 0.5], [1.0, -rho], noise)


def test_rows_of_an_autoregression_are_worth_what_its_correlations_say():
    rows = 200_000
    white = autoregression(0.0, rows, 1)
    for rho in (0.0, 0.5, -0.9):
        series, expected = autoregression(rho, rows), rows * (1 - rho**2) / (1 + rho**2)
        np.testing.assert_allclose(independent_rows(3 * series[:, None]), expected, rtol=0.1)
        both = np.stack([series, white], axis=1)
        np.testing.assert_allclose(independent_rows(both), 2 / (1 / rows + 1 / expected), rtol=0.1)
    assert independent_rows(np.zeros((3, 1))) == 3.0
    assert independent_rows(np.ones((1, 2))) == 1.0
    assert independent_rows(np.full((4, 2), np.nan)) == 0.0


def test_rows_that_are_not_known_are_worth_nothing():
    series = autoregression(0.9, 30_000)
    sparse = np.where(np.arange(30_000) % 30 == 0, series, np.nan)[:, None]
    rho = 0.9**30
    np.testing.assert_allclose(independent_rows(sparse), 1000 * (1 - rho**2) / (1 + rho**2), rtol=0.1)
    now_and_then = np.where(np.random.default_rng(2).random(30_000) < 0.3, series, np.nan)[:, None]
    assert 1000 < independent_rows(now_and_then) < 3000  # 9000 known, and all 30,000 would be worth 3100


def test_independent_errors_beyond_their_bars_are_told_however_much(white):
    truth = 1.2 * np.random.default_rng(6).normal(size=(T, 2))
    assert said(diagnose(made(white), truth), "overconfident about the states")


def test_bars_that_miss_slow_errors_too_often_are_told(white):
    slow = np.stack([autoregression(0.9, T, seed) for seed in (1, 2)], axis=1)
    found = diagnose(made(white), 2 * slow)
    assert 0.6 < found.coverage[0].within[1] < 0.8
    assert said(found, "misses the truth too often")
    assert not said(diagnose(made(white), slow), "covers a")


@pytest.mark.parametrize(("offset", "words"), [(10.0, "misses the truth"), (2.5, "which may be chance")])
def test_bars_that_an_error_never_comes_into_are_not_called_good(white, offset, words):
    found = diagnose(made(white), np.full((T, 2), offset))
    assert found.coverage[0].within[1] == 0
    assert said(found, words)
    assert not [v for v in found.verdicts if v.severity == "good" and "band covers" in v.text]


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
    eye = jnp.eye(1)
    model = sp.StateSpaceModel(lambda x, u: x, lambda x, u: x, 0 * eye, eye, sp.Gaussian(jnp.zeros(1), eye))
    states, rows = jax.vmap(lambda key: sp.simulate(model, 300, key=key))(jax.random.split(jax.random.key(1), 40))
    found = [diagnose(sp.filter(model, y), x) for x, y in zip(states, rows)]
    assert not any(said(each, "misses the truth") for each in found)
    assert any(said(each, "which may be chance") for each in found)
    assert sum(bool(said(each, "overconfident about the states")) for each in found) <= 6  # 2 of 40 expected


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
