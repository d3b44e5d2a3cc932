"""Expectation-maximisation: the textbook's on linear models, and what it claims on others."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.expectation_maximization import Linear, em_step
from turning import as_angle, measured, on_circle, vector

import sigmapoint as sp

A, H = np.array([[0.9, 0.3], [-0.2, 0.8]]), np.array([[1.0, 0.0], [0.5, 1.0]])
TRUE = Linear(A, 0.1 * np.array([[1, 0.5], [0.5, 1.0]]), H, np.array([[0.5, 0.1], [0.1, 0.3]]), np.ones(2), np.eye(2))
START = TRUE._replace(Q=np.eye(2), R=np.eye(2), m0=np.zeros(2))


def _f(x, u):  # one function for every case, so that a method is compiled once for each size
    return A @ x


def _h(x, u):
    return H @ x


def _model(m: Linear) -> sp.StateSpaceModel:
    return sp.StateSpaceModel(_f, _h, m.Q, m.R, sp.Gaussian(m.m0, m.P0))


@cache
def _series(T: int, seed: int = 1) -> jax.Array:
    y = sp.simulate(_model(TRUE), T, key=seed)[1]
    return y.at[T // 3 : T // 3 + 4].set(jnp.nan)


@pytest.mark.filterwarnings("ignore:em. not converged")
@pytest.mark.parametrize("method", [sp.srcdkf(), sp.ekf(), sp.ukf(), sp.srukf(alpha=1e-2), sp.ghkf()])
def test_on_a_linear_model_every_step_is_the_textbooks(method):
    y, expected, likelihoods = _series(40), START, []
    for _ in range(5):
        expected, value = em_step(expected, np.asarray(y))
        likelihoods.append(value)
    found = sp.em(_model(START), y, method=method, steps=5, tolerance=0.0)
    np.testing.assert_allclose(found.log_likelihood[:5], likelihoods, rtol=1e-9)
    model = found.model
    tol = 1e-7 if "0.01" in str(method) else 1e-9
    for value, exact in (
        (model.process_noise.cov, expected.Q),
        (model.observation_noise.cov, expected.R),
        (model.initial.mean, expected.m0),
        (model.initial.cov, expected.P0),
    ):
        np.testing.assert_allclose(value, exact, rtol=tol, atol=tol)


@pytest.mark.filterwarnings("ignore:em. not converged")
def test_a_matrix_of_the_dynamics_is_learned_as_the_textbook_does():
    """By gradient, which for a quadratic ends where the normal equations do."""
    y, expected = _series(60), TRUE._replace(A=0.5 * np.eye(2))

    def build(theta):
        model = _model(TRUE)
        return sp.StateSpaceModel(
            lambda x, u: theta @ x, model.observation, TRUE.Q, TRUE.R, sp.Gaussian(TRUE.m0, TRUE.P0)
        )

    for _ in range(4):
        expected, _ = em_step(expected, np.asarray(y), transition=True)
    found = sp.em(build, y, theta=sp.real(0.5 * jnp.eye(2), 0.5), method=sp.srcdkf(), steps=4, tolerance=0.0)
    np.testing.assert_allclose(found.theta, expected.A, atol=1e-4)
    np.testing.assert_allclose(found.model.process_noise.cov, expected.Q, atol=1e-4)


def test_the_likelihood_rises_at_every_step_and_ends_where_its_slope_is_zero():
    y = _series(80)
    found = sp.em(_model(START), y, initial=None, steps=3000, tolerance=1e-9, method=sp.srekf())
    assert found.converged
    assert (np.diff(found.log_likelihood) > -1e-9 * np.abs(found.log_likelihood[1:])).all()

    def slope(Q, R):
        return sp.filter(_model(START._replace(Q=Q, R=R)), y, method=sp.srekf()).log_likelihood

    noises = found.model.process_noise.cov, found.model.observation_noise.cov
    for gradient, cov in zip(jax.jit(jax.grad(slope, argnums=(0, 1)))(*noises), noises):
        assert (jnp.abs(gradient + gradient.T) * cov < 0.02).all()  # log-likelihood for a relative change


@pytest.mark.filterwarnings("ignore:em. not converged")
@pytest.mark.parametrize("structure", [sp.full, sp.diagonal, sp.tied])
def test_missing_elements_do_not_hinder_and_structures_are_kept(structure):
    y = _series(100)
    y = y.at[20:60, 0].set(jnp.nan).at[70:75, 1].set(jnp.nan)
    found = sp.em(_model(START), y, process_noise=structure, observation_noise=structure, steps=60, tolerance=0.0)
    assert (np.diff(found.log_likelihood) > -1e-9 * np.abs(found.log_likelihood[1:])).all()
    for cov in (found.model.process_noise.cov, found.model.observation_noise.cov):
        np.testing.assert_allclose(structure(cov), cov, rtol=1e-12)
        assert (np.linalg.eigvalsh(cov) > 0).all()


@pytest.mark.filterwarnings("ignore:em. not converged")
def test_series_of_different_lengths_count_by_their_rows():
    y = _series(50)
    once, twice = (sp.em(_model(START), ys, steps=4, tolerance=0.0) for ys in (y, [y, y]))
    np.testing.assert_allclose(twice.log_likelihood, 2 * once.log_likelihood, rtol=1e-10)
    np.testing.assert_allclose(twice.model.process_noise.cov, once.model.process_noise.cov, rtol=1e-9)
    # Rows without a measurement behind the end say nothing of noises that are measured.
    padded = jnp.concatenate([y[:20], jnp.full((30, 2), jnp.nan)])
    ragged, filled = (
        sp.em(_model(START), [y, other], steps=4, tolerance=0.0, process_noise=None) for other in (y[:20], padded)
    )
    np.testing.assert_allclose(ragged.model.observation_noise.cov, filled.model.observation_noise.cov, rtol=1e-9)


def test_what_is_kept_stays():
    y = _series(30)
    found = sp.em(_model(START), y, process_noise=None, initial=None, tolerance=1e-3)
    np.testing.assert_array_equal(found.model.process_noise.cov, START.Q)
    np.testing.assert_array_equal(found.model.initial.cov, START.P0)


def _pendulum(theta) -> sp.StateSpaceModel:
    return sp.StateSpaceModel(
        lambda x, u: jnp.stack([x[0] + 0.1 * x[1], x[1] - 0.1 * theta["k"] * jnp.sin(x[0]) - theta["d"] * x[1]]),
        lambda x, u: jnp.stack([jnp.sin(x[0]), jnp.cos(x[0])]),
        jnp.diag(jnp.array([1e-4, 1e-3])),
        0.04 * jnp.eye(2),
        sp.Gaussian(jnp.array([1.0, 0.0]), 0.1 * jnp.eye(2)),
    )


def _swing(method, **settings):
    true = {"k": 5.0, "d": 0.02}
    y = sp.simulate(_pendulum(true), 400, key=2)[1]
    theta = {"k": sp.positive(3.0, 2.0), "d": sp.positive(0.05, 0.05)}
    fixed = {"process_noise": None, "observation_noise": None, "initial": None}
    return true, y, theta, sp.em(_pendulum, y, theta=theta, method=method, **fixed, **settings)


def test_a_pendulum_is_identified_and_where_fit_ends_em_does():
    method = sp.srcdkf()
    true, y, theta, found = _swing(method, steps=300, tolerance=1e-7)
    fitted = sp.fit(_pendulum, theta, y, method=method)
    std = fitted.estimates.std
    for name, value in true.items():
        assert abs(found.theta[name] - value) < 4 * std[name]
        # EM maximises a bound by Gaussians, fit the filter's likelihood: apart by the approximation.
        assert abs(found.theta[name] - fitted.theta[name]) < 0.2 * std[name]
    assert found.log_likelihood.max() > fitted.log_likelihood - 0.1


def test_where_the_approximation_ends_the_best_model_is_returned_with_a_warning():
    with pytest.warns(UserWarning, match="the log-likelihood fell from"):
        true, y, _, found = _swing(sp.ekf(), tolerance=0.0)
    assert not found.converged
    assert found.log_likelihood[-1] < found.log_likelihood[-2] == found.log_likelihood.max()
    again = sp.filter(found.model, y, method=sp.ekf()).log_likelihood
    np.testing.assert_allclose(again, found.log_likelihood.max(), rtol=1e-9)
    assert abs(found.theta["k"] - true["k"]) < 0.1 * true["k"]


def test_on_a_linear_model_fit_and_em_agree():
    y = _series(120)

    def build(theta):
        return _model(START._replace(Q=jnp.diag(theta["q"]), R=theta["r"] * jnp.eye(2)))

    theta = {"q": sp.positive(jnp.ones(2), jnp.ones(2)), "r": sp.positive(1.0, 1.0)}
    fitted = sp.fit(build, theta, y, method=sp.srekf())
    learned = sp.em(
        _model(START), y, process_noise=sp.diagonal, observation_noise=sp.tied, initial=None, method=sp.srekf(),
        steps=5000, tolerance=1e-11,
    )  # fmt: skip
    np.testing.assert_allclose(learned.log_likelihood[-1], fitted.log_likelihood, atol=1e-5)
    np.testing.assert_allclose(jnp.diagonal(learned.model.process_noise.cov), fitted.theta["q"], rtol=2e-3)
    np.testing.assert_allclose(learned.model.observation_noise.cov[0, 0], fitted.theta["r"], rtol=2e-3)


@pytest.mark.filterwarnings("ignore:em. not converged")
def test_states_of_any_scale_and_in_32_bits():
    scale = np.array([1e-9, 1e6])
    S, inverse = np.diag(scale), np.diag(1 / scale)
    plain, y = _model(START), _series(40)
    scaled = sp.StateSpaceModel(
        lambda x, u: S @ A @ inverse @ x, lambda x, u: H @ inverse @ x, S @ START.Q @ S, START.R,
        sp.Gaussian(S @ START.m0, S @ START.P0 @ S),
    )  # fmt: skip
    one, other = (sp.em(model, y, steps=10, tolerance=0.0) for model in (plain, scaled))
    np.testing.assert_allclose(
        inverse @ other.model.process_noise.cov @ inverse, one.model.process_noise.cov, rtol=1e-8
    )
    short = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32) if isinstance(a, jax.Array) else a, START)
    single = sp.StateSpaceModel(
        lambda x, u: jnp.asarray(A, jnp.float32) @ x, lambda x, u: jnp.asarray(H, jnp.float32) @ x,
        jnp.asarray(short.Q, jnp.float32), jnp.asarray(short.R, jnp.float32),
        sp.Gaussian(jnp.zeros(2, jnp.float32), jnp.eye(2, dtype=jnp.float32)),
    )  # fmt: skip
    low = sp.em(single, y.astype(jnp.float32), steps=10, tolerance=0.0)
    np.testing.assert_allclose(low.model.process_noise.cov, one.model.process_noise.cov, rtol=1e-3, atol=1e-3)


@pytest.mark.filterwarnings("ignore:em. not converged")
def test_points_of_more_numbers_than_directions_are_learned_from_as_the_angle():
    y = measured(40)
    circle, angle = (
        sp.em(build, y, theta=sp.real(0.2, 0.2), method=sp.srekf(), steps=4, tolerance=0.0)
        for build, y in ((on_circle, vector(y)), (as_angle, y))
    )
    np.testing.assert_allclose(circle.log_likelihood, angle.log_likelihood, rtol=1e-8)
    np.testing.assert_allclose(circle.theta, angle.theta, rtol=1e-6)
    for name in ("process_noise", "observation_noise", "initial"):
        np.testing.assert_allclose(getattr(circle.model, name).cov, getattr(angle.model, name).cov, rtol=1e-6)


def test_parameters_beside_noises_that_change_with_time_end_where_fit_does():
    ramp = jnp.linspace(0.02, 1.0, 80)[:, None, None]

    def build(theta):
        return sp.StateSpaceModel(
            lambda x, u: theta * x, lambda x, u: x, 0.3 * ramp, 1.1 - ramp, sp.Gaussian(jnp.ones(1), jnp.eye(1))
        )

    y = sp.simulate(build(0.8), 80, key=4)[1].at[30:40].set(jnp.nan)
    kept = {"process_noise": None, "observation_noise": None, "initial": None}
    found = sp.em(build, y, theta=sp.real(0.5, 0.3), method=sp.srekf(), tolerance=1e-10, steps=500, **kept)
    fitted = sp.fit(build, sp.real(0.5, 0.3), y, method=sp.srekf())
    assert found.converged
    np.testing.assert_allclose(found.theta, fitted.theta, atol=1e-3 * float(fitted.estimates.std))


def test_what_cannot_be_learned_so_is_said():
    model, y = _model(START), _series(10)
    with pytest.raises(ValueError, match="nothing is left to learn"):
        sp.em(model, y, process_noise=None, observation_noise=None, initial=None)
    with pytest.raises(ValueError, match="every element is NaN"):
        sp.em(model, jnp.full((4, 2), jnp.nan))
    with pytest.raises(ValueError, match="model must be a"):
        sp.em(lambda theta: model, y)
    inside = sp.StateSpaceModel(
        lambda x, u, w: A @ x + w, model.observation, sp.NonAdditive(START.Q), START.R, model.initial
    )
    with pytest.raises(ValueError, match="process_noise of the model is not additive"):
        sp.em(inside, y)
    changing = sp.StateSpaceModel(
        model.dynamics, model.observation, np.tile(START.Q, (10, 1, 1)), START.R, model.initial
    )
    with pytest.raises(ValueError, match="changes with time"):
        sp.em(changing, y)
    kept = {"process_noise": None, "observation_noise": None, "initial": None}
    with pytest.raises(ValueError, match="is not finite: start from another"):
        sp.em(_model(START._replace(m0=np.full(2, 1e200))), y)
    box = sp.blackbox(lambda x, *_: A @ x)

    def boxed(theta):
        return sp.StateSpaceModel(lambda x, u: box(theta * x, u), model.observation, START.Q, START.R, model.initial)

    with pytest.raises(ValueError, match="a blackbox has no derivative, which em needs for theta"):
        sp.em(boxed, y, theta=1.0, **kept)
    masked = [np.ma.masked_array(np.ones((3, 2)), np.eye(3, 2))]
    with pytest.raises(ValueError, match="must not be a masked array"):
        sp.em(model, masked)
    with pytest.raises(ValueError, match="steps must be a whole number"):
        sp.em(model, y, steps=0)
    with pytest.warns(UserWarning, match="not converged in 1 steps"):
        sp.em(model, y, steps=1)


@pytest.mark.parametrize(
    ("structure", "got"),
    [
        (sp.fixed, "got fixed, which raises"),
        (jnp.diagonal, r"got diagonal, which gives .*shape=\(2,\)"),
        (lambda moment: np.diag(np.diagonal(moment)), "got <lambda>, which raises TracerArrayConversionError"),
        (lambda moment: "full", "got <lambda>, which raises TypeError"),
    ],
)
@pytest.mark.parametrize("name", ["process_noise", "observation_noise", "initial"])
def test_a_structure_that_gives_no_covariance_is_refused_before_anything_is_compiled(structure, got, name):
    said = rf"em: {name} must be sp.full, sp.diagonal, sp.tied, None .* \(2, 2\) to a covariance \(2, 2\), {got}"
    with pytest.raises(ValueError, match=said):
        sp.em(_model(START), np.ones((3, 2)), **{name: structure})


def test_under_a_transformation_the_way_out_is_named():
    y = np.ones((3, 2))

    def likelihood(q):
        return sp.em(_model(START._replace(Q=q * jnp.eye(2))), y).log_likelihood[-1]

    for called in (jax.jit(likelihood), jax.grad(likelihood), jax.jit(lambda _: sp.em(_model(START), y).converged)):
        with pytest.raises(ValueError, match=r"em is not for use under jax.jit.*sp.log_posterior"):
            called(1.0)


def test_parameters_of_any_size_are_learned():
    def build(t):
        return sp.StateSpaceModel(
            lambda x, u: 0.9 * x + t["small"] * 1e9 * u[:1] + t["large"] * 1e-6 * u[1:], lambda x, u: x,
            1e-3 * jnp.eye(1), 1e-3 * jnp.eye(1), sp.Gaussian(jnp.zeros(1), jnp.eye(1)),
        )  # fmt: skip

    u = jax.random.normal(jax.random.key(0), (200, 2))
    true = {"small": jnp.array(1.5e-9), "large": jnp.array(0.7e6)}
    y = sp.simulate(build(true), 200, key=3, u=u)[1]
    theta, kept = {"small": sp.positive(1e-9, 1e-9), "large": 1e6}, {"process_noise": None, "initial": None}
    found = sp.em(build, y, u, theta=theta, **kept, tolerance=1e-6, steps=500)
    assert (np.diff(found.log_likelihood) > -1e-9 * np.abs(found.log_likelihood[1:])).all()
    for name, value in true.items():
        assert abs(found.theta[name] / value - 1) < 0.02
