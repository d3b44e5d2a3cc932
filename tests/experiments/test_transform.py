"""The transform experiment: references are exact, orders of accuracy are those of theory, results can be read back."""

import json

import jax.numpy as jnp
import numpy as np
import pytest

import sigmapoint as sp
from sigmapoint.experiments import EXPERIMENTS
from sigmapoint.experiments.transform import experiment
from sigmapoint.experiments.transform.cases import CASES, Case, deviation, monte_carlo, truth

ONE = {
    "linearised": (2, 4),
    "UT": (4, 4),
    "CDKF": (6, 6),
    "cubature": (4, 4),
    "simplex": (4, 4),
    "GH(3)": (6, 6),
    "GH(5)": (10, 10),
}
TWO = {
    "linearised": (2, 4),
    "UT": (4, 4),
    "CDKF": (4, 4),
    "cubature": (4, 4),
    "simplex": (3, 3),
    "GH(3)": (6, 6),
    "GH(5)": (10, 10),
}


def closed_form(name):
    """Mean and covariance in closed form."""
    case = CASES[name]
    m, s2 = case.mean, np.diag(case.factor) ** 2
    if name == "x²":
        return m**2 + s2, np.array([4 * m**2 * s2 + 2 * s2**2])
    if name == "exp x":
        return np.exp(m + s2 / 2), np.array([np.exp(2 * m + s2) * np.expm1(s2)])
    if name == "sin x":
        mean = np.sin(m) * np.exp(-s2 / 2)
        return mean, np.array([(1 - np.cos(2 * m) * np.exp(-2 * s2)) / 2 - mean**2])
    (r, a), (vr, va) = m, s2
    mean = r * np.exp(-va / 2) * np.array([np.cos(a), np.sin(a)])
    c, s = np.cos(2 * a) * np.exp(-2 * va), np.sin(2 * a) * np.exp(-2 * va)
    return mean, (r**2 + vr) / 2 * np.array([[1 + c, s], [s, 1 - c]]) - np.outer(mean, mean)


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    out = tmp_path_factory.mktemp("transform")
    return out, EXPERIMENTS["transform"].run(None, 0, out, True)


@pytest.mark.parametrize("name", ["x²", "exp x", "sin x", "polar to Cartesian"])
def test_the_reference_is_the_closed_form(name):
    mean, cov = closed_form(name)
    found = truth(CASES[name])
    np.testing.assert_allclose(found.mean, mean, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(found.cov, cov, rtol=1e-11, atol=1e-14)


def test_the_reference_has_converged_where_there_is_no_closed_form():
    mean, cov = deviation(truth(CASES["mixed, correlated"], 50), truth(CASES["mixed, correlated"], 60))
    assert max(mean, cov) < 1e-12


@pytest.mark.parametrize("rule", experiment.RULES.values(), ids=experiment.RULES)
def test_a_linear_function_is_transformed_exactly(rule):
    A, factor = np.array([[1.0, -2.0], [0.5, 3.0]]), np.array([[0.7, 0.0], [-0.3, 1.1]])
    found = experiment.transform(rule, lambda x: A @ x + 1, jnp.array([2.0, -1.0]), jnp.asarray(factor))
    P = factor @ factor.T
    np.testing.assert_allclose(found.mean, A @ [2.0, -1.0] + 1, rtol=1e-13)
    np.testing.assert_allclose(found.cov, A @ P @ A.T, rtol=1e-12)
    np.testing.assert_allclose(found.cross, P @ A.T, rtol=1e-12)


def test_the_scalar_unscented_rule_with_kappa_2_is_gauss_hermite_of_order_3():
    """Footnote 5 of Wan & van der Merwe (2001)."""
    case = CASES["exp x"]
    mean, factor = jnp.asarray(case.mean), jnp.asarray(case.factor)
    a, b = (experiment.transform(m.rule, case.g, mean, factor) for m in (sp.ukf(1.0, 0.0, 2.0), sp.ghkf(3)))
    np.testing.assert_allclose(jnp.concatenate([a.mean, a.cov[0]]), jnp.concatenate([b.mean, b.cov[0]]), rtol=1e-12)


@pytest.mark.parametrize("name", experiment.NARROWED)
def test_the_error_vanishes_at_the_order_of_theory(quick, name):
    _, rows = quick
    theory = TWO if len(CASES[name].mean) == 2 else ONE
    for method, orders in theory.items():
        for moment, order in zip(("mean", "covariance"), orders):
            quantity = f"order of the error of the {moment}: {name}"
            (row,) = [r for r in rows if r["quantity"] == quantity and r["method"] == method]
            allowed = 0.4 if method == "GH(5)" else 0.02  # tenth order reaches rounding before the prior is narrow
            assert abs(row["measured"] - order) < allowed, (method, moment)
            assert row["published"] in (None, order)


def test_quadratics_are_exact_for_rules_that_match_the_fourth_moment():
    found = experiment.narrowing(CASES["x²"])
    assert found["linearised", "mean"].order == pytest.approx(2, abs=1e-3)
    for method in ("UT", "CDKF", "GH(3)"):
        assert found[method, "mean"].errors.size == found[method, "covariance"].errors.size == 0


def test_a_sample_agrees_with_the_reference():
    draws = 40_000
    for i, case in enumerate(CASES.values()):
        mean, cov = deviation(monte_carlo(case, draws, seed=i), truth(case))
        assert mean < 4 * np.sqrt(len(case.mean) / draws)
        assert cov < 0.1  # kurtosis of exp x: 4σ of its sample variance is 0.08


def test_sampled_covariances_are_those_of_the_inputs():
    case = Case(lambda x: x, np.array([1.0, 2.0]), np.array([[1.0, 0.0], [0.5, 2.0]]))
    found = monte_carlo(case, 100_000, 0)
    np.testing.assert_allclose(found.cross, case.factor @ case.factor.T, atol=0.1)


def test_a_quantity_and_a_method_name_one_row(quick):
    _, rows = quick
    assert len({(row["quantity"], row["method"]) for row in rows}) == len(rows)


def test_what_is_written_can_be_read(quick):
    out, rows = quick
    assert json.loads((out / "results.json").read_text()) == rows
    assert {row["experiment"] for row in rows} == {"transform"}
    assert [p.name for p in sorted(out.glob("*.png"))] == [
        "transform-curve.png",
        "transform-ellipses.png",
        "transform-orders.png",
    ]
    assert (out / "report.html").read_text().count("base64,") == 3
