"""All that looks back: on a linear model each smoother is the textbook's, and each is what it says it is."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from laws.linear import case
from laws.table import LARGEST, METHODS, precision
from oracles.kalman import batch_least_squares
from turning import CIRCLE, as_angle, measured, on_circle, vector

import sigmapoint as sp
from sigmapoint.filtering import scan
from sigmapoint.smoothing.reversal import Reversal
from sigmapoint.step import Filter

SOME = ("ekf", "sr ukf", "extended set", "sr augmented")
"""Methods that differ in what these smoothers see of them; rts is held against all of them in `test_linear`."""
BACK = {"two_filter": sp.two_filter(), "fixed_lag": sp.fixed_lag(50)}


@cache
def _bearing() -> sp.StateSpaceModel:
    """A turning body whose bearing is measured."""
    return sp.StateSpaceModel(
        lambda x, u: jnp.stack([x[0] + x[1], 0.99 * x[1]]),
        lambda x, u: x[:1],
        jnp.diag(jnp.array([1e-3, 1e-4])),
        1e-2 * jnp.eye(1),
        sp.Gaussian(jnp.array([3.0, 0.4]), jnp.diag(jnp.array([0.01, 0.01]))),
        state_space=sp.angles(0),
        observation_space=sp.angles(0),
    )


@cache
def _pendulum() -> sp.StateSpaceModel:
    return sp.StateSpaceModel(
        lambda x, u: jnp.stack([x[0] + 0.1 * x[1], x[1] - 0.98 * jnp.sin(x[0]) + u]),
        lambda x, u: jnp.sin(x[:1]),
        0.01 * jnp.array([[1 / 3, 1 / 2], [1 / 2, 1.0]]),
        0.05 * jnp.eye(1),
        sp.Gaussian(jnp.array([1.5, 0.0]), 0.1 * jnp.eye(2)),
    )


@cache
def _series(T: int) -> tuple[jax.Array, jax.Array]:
    u = 0.1 * jnp.sin(jnp.arange(T))
    y = sp.simulate(_pendulum(), T, key=1, u=u)[1]
    return y.at[T // 2 : T // 2 + 3].set(jnp.nan), u


@pytest.mark.parametrize("smoother", BACK)
@pytest.mark.parametrize(
    "method", [name if name in SOME else pytest.param(name, marks=pytest.mark.slow) for name in METHODS]
)
def test_on_a_linear_model_it_is_rauch_tung_striebel(method, smoother):
    n = min(3, LARGEST.get(method, 3))
    model, y, u, _, smoothed = case(n)
    found = sp.smooth(model, y, u, METHODS[method], smoother=BACK[smoother])
    tol = max(precision(method), 1e-9)
    np.testing.assert_allclose(found.mean, smoothed.mean, rtol=tol, atol=tol)
    np.testing.assert_allclose(found.cov, smoothed.cov, rtol=tol, atol=tol)


@pytest.mark.parametrize("n", [1, pytest.param(2, marks=pytest.mark.slow), 5, pytest.param(13, marks=pytest.mark.slow)])
@pytest.mark.parametrize("smoother", BACK)
def test_in_any_dimension(n, smoother):
    model, y, u, _, smoothed = case(n)
    found = sp.smooth(model, y, u, sp.srcdkf(), smoother=BACK[smoother])
    np.testing.assert_allclose(found.mean, smoothed.mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.cov, smoothed.cov, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("method", "tol"),
    # A covariance keeps half the digits that its root does beside a variance of 1e11.
    [(sp.srcdkf(), 1e-9), (sp.srekf(), 1e-9), (sp.ekf(), 1e-6), (sp.ukf(), 1e-6), (sp.augmented(sp.srukf()), 1e-7)],
)
def test_a_backward_model_that_knows_nothing_at_the_end_gives_batch_least_squares(method, tol):
    r = np.random.default_rng(0)
    T, n, m = 15, 2, 1
    A, b = np.array([[0.9, 0.4], [-0.3, 0.8]]), np.array([0.2, -0.1])
    H, Q, R, P0 = r.normal(size=(m, n)), np.diag([0.3, 0.1]), 0.2 * np.eye(m), np.eye(n)
    y = r.normal(size=(T, m))
    y[4] = np.nan
    model = sp.StateSpaceModel(lambda x, u: A @ x + b * u, lambda x, u: H @ x, Q, R, sp.Gaussian(np.zeros(n), P0))
    inverse = np.linalg.inv(A)
    back = sp.two_filter(
        lambda x, u: inverse @ (x - b * u),
        noise=inverse @ Q @ inverse.T,
        initial=sp.Gaussian(np.zeros(n), 1e11 * np.eye(n)),
    )
    u = r.normal(size=T)
    found = sp.smooth(model, y, u, method, smoother=back)
    F, offsets = np.tile(A, (T, 1, 1)), b * u[:, None]
    exact = batch_least_squares(
        F, offsets, np.tile(Q, (T, 1, 1)), np.tile(H, (T, 1, 1)), np.zeros((T, m)), np.tile(R, (T, 1, 1)), np.zeros(n),
        P0, y,
    )  # fmt: skip
    np.testing.assert_allclose(found.mean, exact.mean, rtol=tol, atol=tol)
    np.testing.assert_allclose(found.cov, exact.cov, rtol=tol, atol=tol)


@pytest.mark.parametrize("method", [sp.srcdkf(), sp.ukf(), sp.extended_set(sp.cdkf())])
def test_with_a_lag_each_state_is_from_measurements_so_far_ahead(method):
    (y, u), model, lag = _series(20), _pendulum(), 4
    found = sp.smooth(model, y, u, method, smoother=sp.fixed_lag(lag))
    for k in (0, 7, 17, 19):
        exact = sp.smooth(model, y.at[k + lag + 1 :].set(jnp.nan), u, method)  # what is not measured tells nothing
        np.testing.assert_allclose(found.mean[k], exact.mean[k], rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(found.cov[k], exact.cov[k], rtol=1e-9, atol=1e-12)
    filtered = sp.filter(model, y, u, method)
    np.testing.assert_allclose(sp.smooth(model, y, u, method, smoother=sp.fixed_lag(0)).mean, filtered.mean)


@pytest.mark.parametrize("method", [sp.srcdkf(), sp.ekf()])
def test_live_it_is_the_same(method):
    (y, u), model, lag = _series(12), _pendulum(), 3
    offline = sp.smooth(model, y, u, method, smoother=sp.fixed_lag(lag))
    live = sp.online_smoother(model, lag, method)
    state = live.init()
    u = [float(value) for value in u]
    for k in range(12):
        state, _ = live.update(state, y[k], u[k])
        window = live.smoothed(state)
        if k >= lag:
            np.testing.assert_allclose(window.mean[0], offline.mean[k - lag], rtol=1e-9, atol=1e-11)
            np.testing.assert_allclose(window.cov[0], offline.cov[k - lag], rtol=1e-9, atol=1e-11)
        else:
            assert jnp.isnan(window.mean[: lag - k]).all()
            assert jnp.isfinite(window.mean[lag - k :]).all()
        np.testing.assert_array_equal(window.mean[-1], state.mean)
        np.testing.assert_array_equal(window.std[-1], state.std)
        state = live.predict(state, u[k])
    np.testing.assert_allclose(window.mean, offline.mean[-lag - 1 :], rtol=1e-9, atol=1e-11)


def test_prepared_ahead_no_sample_compiles_anything(caplog):
    model = _pendulum.__wrapped__()  # one that nothing has been compiled for
    (y, u), live = jax.tree.map(np.asarray, _series(4)), sp.online_smoother(model, 2)
    state = live.prepare(np.zeros(y.shape[1]), 0.0)
    assert int(state.filter.step) == 0
    caplog.clear()
    with jax.log_compiles():
        for k in range(4):
            state, _ = live.update(state, y[k], u[k])
            live.smoothed(state)
            state = live.predict(state, u[k])
    assert not caplog.records


@pytest.mark.parametrize("n", [1, 3])
@pytest.mark.parametrize("method", [sp.srukf(), sp.cdkf()])
def test_covariances_of_neighbours_are_the_textbooks(n, method):
    model, y, u, _, smoothed = case(n)
    run = Filter.of(model, method)

    @jax.jit
    def gains(y, u):
        states = scan(run, y, u, lambda state, _: state)[0]
        return jax.vmap(lambda state, u: Reversal.of(run, state, u).gain)(states, u)

    across = sp.smooth(model, y, u, method).cov[1:] @ gains(jnp.asarray(y), u)[:-1].mT
    np.testing.assert_allclose(across, smoothed.lag_one_cov, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("method", [sp.srukf(), sp.ekf()])
def test_drawn_trajectories_have_the_smoothed_moments(method):
    model, y, u, _, smoothed = case(2)
    draws = 20_000
    x = np.asarray(sp.trajectories(model, y, u, method, key=0, draws=draws))
    std = np.sqrt(np.einsum("kii->ki", smoothed.cov))
    assert (np.abs(x.mean(0) - smoothed.mean) < 5 * std / draws**0.5).all()
    e = x - smoothed.mean
    for lag, exact in ((0, smoothed.cov), (1, smoothed.lag_one_cov)):
        found = np.einsum("dki,dkj->kij", e[:, lag:], e[:, : len(y) - lag]) / draws
        bound = std[lag:, :, None] * std[: len(y) - lag, None, :]
        assert (np.abs(found - exact) < 5 * 2**0.5 * bound / draws**0.5).all()


def test_a_nonlinear_model_is_smoothed_much_alike_in_both_ways():
    """They linearise at the same beliefs, the one about x[k], the other about where x[k] leads to."""
    (y, u), model = _series(30), _pendulum()
    for method in (sp.ekf(), sp.srcdkf()):
        one, other = (sp.smooth(model, y, u, method, smoother=s) for s in (sp.rts(), sp.two_filter()))
        assert (jnp.abs(one.mean - other.mean) < 0.5 * one.std).all()
        assert (one.std <= sp.filter(model, y, u, method).std + 1e-12).all()


@pytest.mark.parametrize("name", ["rts", "two_filter", "fixed_lag", "backward"])
def test_a_bearing_that_wraps_is_smoothed_across_the_cut(name):
    model = _bearing()
    x, y = sp.simulate(model, 40, key=3)
    backward = sp.two_filter(
        lambda x, u: jnp.stack([x[0] - x[1] / 0.99, x[1] / 0.99]),
        noise=jnp.array([[1.1e-3, -1e-4], [-1e-4, 1.1e-4]]),
        initial=sp.Gaussian(y[-1, 0] * jnp.array([1.0, 0.0]), jnp.diag(jnp.array([1.0, 1.0]))),
    )
    smoother = {"rts": sp.rts(), "backward": backward, **BACK}[name]
    found = sp.smooth(model, y, method=sp.srcdkf(), smoother=smoother)
    error = jax.vmap(model.state_space.residual)(found.mean, x)
    assert (jnp.abs(error) < 4 * found.std).all()
    assert found.std.mean() < 0.9 * sp.filter(model, y).std.mean()


SMOOTHERS = {
    "rts": lambda m: sp.rts(),
    "two_filter": lambda m: sp.two_filter(),
    "fixed_lag": lambda m: sp.fixed_lag(3),
    "backward": lambda m: sp.two_filter(
        lambda x, u: m.state_space.retract(x, jnp.array([-0.3])),
        noise=1e-3 * jnp.eye(1),
        initial=sp.Gaussian(m.initial.mean, jnp.eye(1)),
    ),
}


@pytest.mark.parametrize("name", SMOOTHERS)
def test_points_of_more_numbers_than_directions_are_smoothed_as_the_angle(name):
    y = measured(25)
    (circle, x), (_angle, a) = (
        (model, sp.smooth(model, y, method=sp.srcdkf(), smoother=SMOOTHERS[name](model)))
        for model, y in ((on_circle(0.3), vector(y)), (as_angle(0.3), y))
    )
    assert circle.state_space is CIRCLE
    np.testing.assert_allclose(x.mean, vector(jnp.asarray(a.mean)), atol=1e-9)
    np.testing.assert_allclose(x.cov, a.cov, rtol=1e-8)


def test_such_points_live_and_drawn():
    y = measured(25)
    live, flat = (sp.online_smoother(model(0.3), 4, sp.srcdkf()) for model in (on_circle, as_angle))
    s, a = live.init(), flat.init()
    for row in y:
        (s, _), (a, _) = live.update(s, vector(row)), flat.update(a, row)
        here, there = live.smoothed(s), flat.smoothed(a)
        s, a = live.predict(s), flat.predict(a)
    np.testing.assert_allclose(here.mean, vector(there.mean), atol=1e-9)
    np.testing.assert_allclose(here.std, there.std, rtol=1e-8)
    x, a = (
        sp.trajectories(model, y, method=sp.srcdkf(), key=0, draws=5)
        for model, y in ((on_circle(0.3), vector(y)), (as_angle(0.3), y))
    )
    np.testing.assert_allclose(x, vector(a), atol=1e-9)


@pytest.mark.parametrize("method", [sp.srcdkf(), sp.srekf()])
def test_a_backward_model_with_noises_that_change_with_time_gives_batch_least_squares(method):
    r = np.random.default_rng(1)
    T, n = 12, 2
    A, H = np.array([[0.9, 0.4], [-0.3, 0.8]]), r.normal(size=(1, n))
    Q = np.linspace(0.1, 2.0, T)[:, None, None] * np.diag([0.3, 0.1])
    R = np.linspace(0.5, 0.05, T)[:, None, None] * np.eye(1)
    y, P0, inverse = r.normal(size=(T, 1)), np.eye(n), np.linalg.inv(A)
    model = sp.StateSpaceModel(lambda x, u: A @ x, lambda x, u: H @ x, Q, R, sp.Gaussian(np.zeros(n), P0))
    end = sp.Gaussian(np.zeros(n), 1e11 * np.eye(n))
    back = sp.two_filter(lambda x, u: inverse @ x, noise=inverse @ Q @ inverse.T, initial=end)
    found = sp.smooth(model, y, method=method, smoother=back)
    F, zero = np.tile(A, (T, 1, 1)), np.zeros((T, n))
    exact = batch_least_squares(F, zero, Q, np.tile(H, (T, 1, 1)), np.zeros((T, 1)), R, np.zeros(n), P0, y)
    np.testing.assert_allclose(found.mean, exact.mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.cov, exact.cov, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    "smoother", [BACK["two_filter"], pytest.param(BACK["fixed_lag"], marks=pytest.mark.slow), sp.fixed_lag(2)]
)
@pytest.mark.parametrize("method", [sp.srcdkf(), pytest.param(sp.ukf(), marks=pytest.mark.slow)])
def test_series_of_different_lengths_are_smoothed_as_alone(method, smoother):
    model = _pendulum()
    series = [_series(T) for T in (1, 9, 20)]
    ys, us = ([one[i] for one in series] for i in (0, 1))
    together = sp.batch(model, ys, us, method, smoother=smoother)
    for y, u, found in list(zip(ys, us, together))[:2]:  # the longest is not filled up
        alone = sp.smooth(model, y, u, method, smoother=smoother)
        np.testing.assert_allclose(found.mean, alone.mean, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(found.cov, alone.cov, rtol=1e-9, atol=1e-10)


def test_a_backward_model_in_a_batch_of_different_lengths():
    model = _pendulum()
    back = sp.two_filter(
        lambda x, u: jnp.stack([x[0] - 0.1 * x[1], x[1] + 0.98 * jnp.sin(x[0] - 0.1 * x[1]) - u]),
        noise=0.02 * jnp.eye(2),
        initial=sp.Gaussian(jnp.zeros(2), 4 * jnp.eye(2)),
    )
    series = [_series(T) for T in (5, 12)]
    ys, us = ([one[i] for one in series] for i in (0, 1))
    for y, u, found in zip(ys, us, sp.batch(model, ys, us, sp.srukf(), smoother=back)):
        alone = sp.smooth(model, y, u, sp.srukf(), smoother=back)
        np.testing.assert_allclose(found.mean, alone.mean, rtol=1e-9, atol=1e-10)


def test_what_cannot_be_smoothed_so_is_said():
    eye = jnp.eye(1)
    with pytest.raises(ValueError, match="lag must be a whole number of at least 0"):
        sp.fixed_lag(-1)
    with pytest.raises(ValueError, match="lag must be a whole number of at least 1"):
        sp.online_smoother(_pendulum(), 0)
    with pytest.raises(ValueError, match="noise and initial are those of a backward model"):
        sp.two_filter(noise=eye)
    with pytest.raises(ValueError, match="needs its noise"):
        sp.two_filter(lambda x, u: x)
    with pytest.raises(ValueError, match="needs initial"):
        sp.two_filter(lambda x, u: x, noise=eye)
    with pytest.raises(ValueError, match="noise has a negative variance"):
        sp.two_filter(lambda x, u: x, noise=-eye, initial=sp.Gaussian(jnp.zeros(1), eye))
    short = sp.two_filter(lambda x, u: x, noise=jnp.tile(jnp.eye(2), (2, 1, 1)), initial=_pendulum().initial)
    with pytest.raises(ValueError, match="noise is given for 2 instants"):
        sp.smooth(_pendulum(), jnp.ones((6, 1)), jnp.zeros(6), smoother=short)
    other = sp.two_filter(lambda x, u: x, noise=jnp.eye(2), initial=sp.Gaussian(jnp.zeros(3), jnp.eye(3)))
    with pytest.raises(ValueError, match="initial must have a mean of shape"):
        sp.smooth(_pendulum(), jnp.ones((6, 1)), jnp.zeros(6), smoother=other)
    with pytest.raises(ValueError, match="draws must be a whole number"):
        sp.trajectories(_pendulum(), jnp.ones((3, 1)), jnp.zeros(3), key=0, draws=0)
