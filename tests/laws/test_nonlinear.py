"""On nonlinear models: dense = square root, each = its textbook form, and where carrying points is no change."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from laws.table import PAIRS, precision
from oracles import augmented as augmented_oracle
from oracles import central_difference, cubature, extended, gauss_hermite, posterior_linearization, smoothing, unscented
from oracles.models import NAMES, problems, simulate

import sigmapoint as sp

TRACED, TEXTBOOK = problems(jnp), problems(np)
# Units of the posterior's standard deviation. Re-entry has states of 6400 with a deviation of 0.01, and a measurement
# changed by 1e-13 of itself moves its estimates by up to 5e-9 deviations.
TOLERANCE = {"reentry": 5e-8}


def _model(name: str) -> sp.StateSpaceModel:
    p = TRACED[name]
    return sp.StateSpaceModel(p.f, p.h, p.Q, p.R, sp.Gaussian(p.m0, p.P0))


def _far(a, b, std) -> float:
    return float(np.max(np.abs(np.asarray(a) - np.asarray(b)) / np.asarray(std)))


def _std(cov) -> np.ndarray:
    return np.sqrt(np.einsum("tii->ti", cov))


# Methods that differ in how a square root is made on one problem, one method on every problem; the rest is `slow`:
# every method on that problem, and some methods on every problem.
DIFFERENT = ("ekf", "ukf", "simplex_ukf", "cdkf", "ghkf", "ukf(1e-3)", "extended set", "augmented")
QUICK = [("coordinated_turn", method) for method in DIFFERENT]
QUICK += [(name, "cdkf") for name in NAMES if name != "coordinated_turn"]
MORE = [("coordinated_turn", method) for method in PAIRS if method not in DIFFERENT]
MORE += [(name, method) for name in NAMES for method in ("ekf", "ukf", "simplex_ukf", "augmented")]
SLOW = [pytest.param(*pair, marks=pytest.mark.slow) for pair in MORE if pair not in QUICK]


@pytest.mark.parametrize(("name", "method"), QUICK + SLOW)
def test_dense_is_square_root(name, method):
    problem = TEXTBOOK[name]
    _, y = simulate(problem, 0)
    dense, root = (sp.filter(_model(name), y, problem.u, m) for m in PAIRS[method])
    tolerance = TOLERANCE.get(name, 10 * precision(method))
    assert _far(dense.mean, root.mean, dense.std) < tolerance
    assert _far(dense.std, root.std, dense.std) < tolerance
    assert abs(dense.log_likelihood - root.log_likelihood) < tolerance * abs(dense.log_likelihood) + tolerance


TEXTBOOK_FORMS = {
    "ukf": (sp.ukf(), unscented.additive_ukf, {}),
    "ukf(1,0,2)": (sp.ukf(1.0, 0.0, 2.0), unscented.additive_ukf, {"alpha": 1.0, "beta": 0.0, "kappa": 2.0}),
    "cdkf": (sp.cdkf(), central_difference.cdkf, {}),
    "ckf": (sp.ckf(), cubature.ckf, {}),
    "extended set": (sp.extended_set(sp.ukf()), unscented.extended_set_ukf, {}),
}


@pytest.mark.parametrize("form", TEXTBOOK_FORMS)
@pytest.mark.parametrize("name", ["coordinated_turn", "lorenz_63", "epidemic"])
def test_each_is_its_textbook_form(name, form):
    method, oracle, settings = TEXTBOOK_FORMS[form]
    problem = TEXTBOOK[name]
    _, y = simulate(problem, 1)
    expected = oracle(*problem[1:7], y, problem.u, **settings)
    got = sp.filter(_model(name), y, problem.u, method)
    assert _far(got.mean, expected.mean, _std(expected.cov)) < 1e-9
    np.testing.assert_allclose(got.log_likelihood, expected.log_likelihood, rtol=1e-9)


@pytest.mark.parametrize("order", [2, 3, 4, 5])
def test_gauss_hermite_of_any_order_is_its_textbook_form(order):
    problem = TEXTBOOK["pendulum"]
    _, y = simulate(problem, 0)
    expected = gauss_hermite.ghkf(*problem[1:7], y, problem.u, order=order)
    for method in (sp.ghkf(order), sp.srghkf(order)):
        assert _far(sp.filter(_model("pendulum"), y, None, method).mean, expected.mean, _std(expected.cov)) < 1e-9


@pytest.mark.parametrize(
    "settings", [pytest.param((1.0, 2.0, 0.0), marks=pytest.mark.slow), (1.0, 0.0, 2.0), (0.5, 2.0, 1.0)]
)
@pytest.mark.parametrize("first", ["update", "predict"])
def test_fully_augmented_form_is_table_7_3_1_on_the_growth_model(settings, first):
    problem, names = TEXTBOOK["growth"], ("alpha", "beta", "kappa")
    _, y = simulate(problem, 0)
    expected = unscented.augmented_ukf(
        lambda x, u, v: problem.f(x, u) + v,
        lambda x, u, n: problem.h(x, u) + n,
        *problem[3:7],
        y if first == "update" else y[1:],
        problem.u,
        first=first,
        **dict(zip(names, settings)),
    )
    for method in (sp.ukf(*settings), sp.srukf(*settings)):
        if first == "update":
            got = sp.filter(_model("growth"), y, problem.u, sp.augmented(method)).mean
        else:
            live = sp.online(_model("growth"), sp.augmented(method))
            state, means = live.init(), []
            for k in range(1, len(y)):
                state, _ = live.update(live.predict(state, problem.u[k - 1]), y[k], problem.u[k])
                means.append(state.mean)
            got = np.stack(means)
        np.testing.assert_allclose(got, expected.mean, rtol=1e-10, atol=1e-10)


def test_augmented_central_differences_and_non_additive_noise_are_the_textbook_form():
    problem = TEXTBOOK["growth"]
    _, y = simulate(problem, 2)

    def f(x, u, w):
        return problem.f(x, u) + w * (1 + 0.1 * x)

    def h(x, u, v):
        return problem.h(x, u) + v * (1 + 0.01 * x)

    expected = augmented_oracle.augmented_filter(
        central_difference.central_difference_transform, f, h, *problem[3:7], y, problem.u, first="update"
    )
    traced = TRACED["growth"]
    model = sp.StateSpaceModel(
        lambda x, u, w: traced.f(x, u) + w * (1 + 0.1 * x),
        lambda x, u, v: traced.h(x, u) + v * (1 + 0.01 * x),
        sp.NonAdditive(problem.Q),
        sp.NonAdditive(problem.R),
        sp.Gaussian(problem.m0, problem.P0),
    )
    for method in (sp.cdkf(), sp.srcdkf()):
        got = sp.filter(model, y, problem.u, sp.augmented(method))
        np.testing.assert_allclose(got.mean, expected.mean, rtol=1e-9, atol=1e-9)


def test_what_a_set_may_be_depends_on_all_that_it_covers():
    one = jnp.eye(1)
    model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, one, one, sp.Gaussian(jnp.zeros(1), one))
    y, fourth = jnp.ones((4, 1)), sp.ukf(1.0, 2.0, -1.5)
    got = sp.filter(model, y, method=sp.augmented(fourth))  # κ > −3
    np.testing.assert_allclose(got.mean, sp.filter(model, y, method=sp.ekf()).mean, rtol=1e-12)
    with pytest.raises(ValueError, match="kappa must be greater than -n"):
        sp.filter(model, y, method=fourth)


def test_stacking_additive_noise_changes_nothing_where_that_is_a_theorem_and_something_where_not():
    """With f(x) + w, points along w leave central differences, product rules and the EKF as they are; the unscented
    set spreads with the dimension, and a set carried through h sees what redrawing forgets."""
    problem, traced = TEXTBOOK["growth"], TRACED["growth"]
    _, y = simulate(problem, 0)
    additive = _model("growth")
    stacked = sp.StateSpaceModel(
        lambda x, u, w: traced.f(x, u) + w,
        lambda x, u, v: traced.h(x, u) + v,
        sp.NonAdditive(problem.Q),
        sp.NonAdditive(problem.R),
        additive.initial,
    )

    def mean(model, method):
        return np.asarray(sp.filter(model, y, problem.u, method).mean)

    for same in (sp.ekf(), sp.srekf(), sp.cdkf(), sp.srcdkf(), sp.ghkf(), sp.ukf(1.0, 2.0, 0.0), sp.ckf()):
        difference = np.abs(mean(additive, same) - mean(stacked, same)).max()
        if same in (sp.ukf(1.0, 2.0, 0.0), sp.ckf()):
            assert difference > 1e-3, same
        else:
            assert difference < 1e-9, same
    np.testing.assert_array_equal(mean(additive, sp.augmented(sp.ekf())), mean(additive, sp.ekf()))
    for carried in (sp.augmented, sp.extended_set):
        assert np.abs(mean(additive, carried(sp.cdkf())) - mean(additive, sp.cdkf())).max() > 1e-3


def test_iterated_updates_are_their_textbook_forms():
    name = "bearings_only"
    problem, traced = TEXTBOOK[name], TRACED[name]
    _, y = simulate(problem, 0)
    f_jacobian = jax.jit(jax.jacfwd(traced.f))
    h_jacobian = jax.jit(jax.jacfwd(traced.h))
    iekf = extended.extended_kalman_filter(
        problem.f,
        problem.h,
        lambda x, u: np.asarray(f_jacobian(jnp.asarray(x), u)),
        lambda x, u: np.asarray(h_jacobian(jnp.asarray(x), u)),
        *problem[3:7],
        y,
        problem.u,
        iterations=3,
    )
    iplf = posterior_linearization.iplf(*problem[1:7], y, problem.u, iterations=3)
    for expected, methods in ((iekf, (sp.ekf(), sp.srekf())), (iplf, (sp.ckf(), sp.srckf()))):
        for method in methods:
            got = sp.filter(_model(name), y, problem.u, sp.iterated(method, 3))
            assert _far(got.mean, expected.mean, _std(expected.cov)) < 1e-9
            assert _far(got.std, _std(expected.cov), _std(expected.cov)) < 1e-9


@pytest.mark.parametrize("name", ["coordinated_turn", "van_der_pol"])
def test_smoother_is_its_textbook_form(name):
    problem = TEXTBOOK[name]
    _, y = simulate(problem, 0)
    expected = smoothing.gaussian_smoother(
        central_difference.central_difference_transform,
        problem.f,
        problem.Q,
        central_difference.cdkf(*problem[1:7], y, problem.u),
        problem.u,
    )
    for method in (sp.cdkf(), sp.srcdkf()):
        got = sp.smooth(_model(name), y, problem.u, method)
        assert _far(got.mean, expected.mean, _std(expected.cov)) < 1e-9
        assert _far(got.std, _std(expected.cov), _std(expected.cov)) < 1e-9


def test_user_jacobians_give_the_same_extended_filter():
    problem = TRACED["pendulum"]
    _, y = simulate(TEXTBOOK["pendulum"], 0)
    with_own = sp.StateSpaceModel(
        problem.f,
        problem.h,
        problem.Q,
        problem.R,
        sp.Gaussian(problem.m0, problem.P0),
        dynamics_jacobian=jax.jacrev(problem.f),
        observation_jacobian=jax.jacrev(problem.h),
    )
    for method in (sp.ekf(), sp.ukf()):
        a, b = (sp.filter(m, y, None, method) for m in (with_own, _model("pendulum")))
        np.testing.assert_allclose(a.mean, b.mean, rtol=1e-12, atol=1e-12)
