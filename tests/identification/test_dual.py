"""Dual estimation against the plain state filter, against derivatives through time, and against exact posteriors."""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from turning import as_angle, measured, on_circle, vector

import sigmapoint as sp
from sigmapoint.identification.costs import Seen
from sigmapoint.step import Filter

T = 60
STATE_METHODS = {
    "ekf": sp.ekf(),
    "srukf": sp.srukf(),
    "iterated": sp.iterated(sp.srckf(), 3),
}
COSTS = {
    "weighted": sp.prediction_error(),
    "plain": sp.prediction_error(0.3),
    "learned": sp.prediction_error(sp.learned_noise(0.3, rate=0.05)),
    "likelihood": sp.maximum_likelihood(),
}


def build(theta):
    """Two states, two measured elements, an input, noises and an initial belief that depend on the parameters."""
    a, q = theta["a"], theta["q"]
    return sp.StateSpaceModel(
        lambda x, u: jnp.stack([a * x[0] + 0.2 * jnp.sin(x[1]) + u, 0.9 * x[1]]),
        lambda x, u: jnp.stack([x[0] + 0.1 * x[1] ** 2, x[1] - u]),
        jnp.diag(jnp.stack([q, 0.1 + 0 * q])),
        jnp.diag(jnp.array([0.2, 0.5])),
        sp.Gaussian(jnp.stack([a, 0 * a]), jnp.eye(2)),
    )


def from_vector(z):
    return build({"a": z[0], "q": z[1]})


@cache
def series(rows=T):
    u = jnp.sin(jnp.arange(float(rows)) / 5.0)
    _, y = sp.simulate(build({"a": jnp.array(0.8), "q": jnp.array(0.1)}), rows, u=u, key=jax.random.key(0))
    return y.at[3, 0].set(jnp.nan).at[7].set(jnp.nan), u


THETA = {"a": sp.real(0.5, 0.3), "q": sp.positive(0.2, 0.15)}


def linear(b, d=0.0):
    """A model in which no covariance depends on the parameters: linear in states and parameters together."""
    return sp.StateSpaceModel(
        lambda x, u: 0.9 * x + b * u, lambda x, u: x + d * u**2, 0.1 * jnp.eye(1), 0.2 * jnp.eye(1),
        sp.Gaussian(jnp.zeros(1), jnp.eye(1)),
    )  # fmt: skip


@pytest.mark.parametrize("method", STATE_METHODS.values(), ids=STATE_METHODS)
def test_known_parameters_leave_the_plain_state_filter(method):
    y, u = series()
    known = sp.Gaussian(jnp.array([0.8, 0.1]), jnp.zeros((2, 2)))
    post = sp.dual(from_vector, known, state_method=method).filter(y, u).post
    plain = sp.filter(from_vector(known.mean), y, u, method)
    for name in ("mean", "cov", "std", "innovation", "innovation_cov", "nis", "log_likelihood"):
        np.testing.assert_allclose(getattr(post, name), getattr(plain, name), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("state_method", "parameter_method"), [(sp.ekf(), sp.ekf()), (sp.ekf(), sp.srukf())], ids=["ekf", "points"]
)
def test_memory_slope_is_the_derivative_through_the_whole_filter(state_method, parameter_method):
    y, u = series(25)
    z = jnp.array([0.8, 0.1])
    narrow = sp.Gaussian(z, 1e-12 * jnp.eye(2))  # so well known that they stay where they are
    found = sp.dual(from_vector, narrow, state_method=state_method, parameter_method=parameter_method).filter(y, u)

    def last(z):
        post = sp.filter(from_vector(z), y, u, state_method)
        return post.mean[-1], post.cov[-1]

    (mean, cov), memory = jax.jit(jax.jacfwd(last))(z), found.state.learner.memory
    np.testing.assert_allclose(memory.slope[:2], mean, rtol=1e-5, atol=1e-7)
    L, slope = found.state.cell.belief(memory.mean).factor, memory.slope[2:]
    along = jnp.zeros((2, 2, 2)).at[np.tril_indices(2)].set(slope)  # of the factor
    grown = jnp.einsum("ijl,kj->ikl", along, L)
    np.testing.assert_allclose(grown + grown.swapaxes(0, 1), cov, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("parameter_method", [sp.ekf(), sp.ukf()], ids=["ekf", "ukf"])
def test_linear_parameters_have_the_exact_joint_posterior(parameter_method):
    u = jnp.sin(jnp.arange(float(T)) / 3.0)
    _, y = sp.simulate(linear(0.7, 0.4), T, u=u, key=jax.random.key(1))
    theta = {"b": sp.real(0.0, 1.0), "d": sp.real(0.0, 2.0)}
    found = sp.dual(lambda t: linear(**t), theta, parameter_method=parameter_method).filter(y, u)
    exact = sp.filter(sp.joint(lambda t: linear(**t), theta), y, u, sp.ekf())
    np.testing.assert_allclose(found.post.mean[:, 0], exact.mean[:, 0], rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found.post.std[:, 0], exact.std[:, 0], rtol=1e-8)
    for ours, its in zip(jax.tree.leaves(found.estimates), jax.tree.leaves(sp.estimates(theta, exact))):
        np.testing.assert_allclose(ours, its, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("cost", [sp.prediction_error(), sp.maximum_likelihood()], ids=["error", "likelihood"])
def test_a_pole_has_nearly_the_posterior_of_a_grid(cost):
    def model(a):
        return sp.StateSpaceModel(
            lambda x, u: a * x, lambda x, u: x, 0.1 * jnp.eye(1), 0.1 * jnp.eye(1), sp.Gaussian(jnp.ones(1), jnp.eye(1))
        )

    _, y = sp.simulate(model(0.8), 800, key=jax.random.key(2))
    found = sp.dual(model, sp.real(0.6, 0.2), cost=cost, parameter_method=sp.ekf()).filter(y).estimates
    grid = jnp.linspace(0.5, 0.99, 400)
    likelihoods = jax.jit(jax.vmap(lambda a: sp.filter(model(a), y, keep=()).log_likelihood))
    fit = likelihoods(grid) - 0.5 * ((grid - 0.6) / 0.2) ** 2
    weight = jax.nn.softmax(fit)
    mean = jnp.sum(weight * grid)
    std = jnp.sqrt(jnp.sum(weight * (grid - mean) ** 2))
    # One pass, linearised where the estimate was, not where it ended: measured 0.3 and 10 %.
    assert abs(found.value[-1] - mean) < 0.5 * std
    np.testing.assert_allclose(found.std[-1], std, rtol=0.25)


def test_half_the_squared_errors_are_minus_the_log_likelihood():
    y, u = series(4)
    cell = sp.dual(build, THETA, cost=sp.maximum_likelihood()).cell

    def both(z, y):
        run = Filter.of(cell.model(z), sp.srukf())
        info = run.update(run.predict(run.init(), u[0]), y, u[1])[1]
        present = jax.lax.stop_gradient(Seen.of(run.update(run.predict(run.init(), u[0]), y, u[1])[1]))
        return 0.5 * jnp.sum(cell.cost.errors(Seen.of(info), present) ** 2), -info.log_likelihood

    gradients = jax.jit(jax.jacfwd(both))
    for row in y:  # one of them lacks an element
        np.testing.assert_allclose(*gradients(jnp.array([0.3, -0.4]), row), rtol=1e-10)
    np.testing.assert_array_equal(gradients(jnp.zeros(2), jnp.full(2, jnp.nan))[0], 0)


def test_errors_of_the_likelihood_are_it_away_from_the_present_too_and_go_on_smoothly():
    def seen(s):
        return Seen(jnp.array([0.5]), jnp.sqrt(s)[None, None], jnp.array([True]))

    cost, variance = sp.maximum_likelihood(), jnp.linspace(0.7, 3.0, 9)
    half = jax.vmap(lambda s: 0.5 * jnp.sum(cost.errors(seen(s), seen(jnp.array(1.0))) ** 2))(variance)
    np.testing.assert_allclose(jnp.diff(half), jnp.diff(0.5 * jnp.log(variance) + 0.125 / variance), rtol=1e-10)
    small = jax.vmap(lambda s: cost.errors(seen(s), seen(jnp.array(1.0)))[1, 0])(
        jnp.exp(jnp.array([-9.0, -0.51, -0.5]))
    )
    assert np.isfinite(small).all()
    assert (np.diff(small) > 0).all()
    np.testing.assert_allclose(small[1], small[2], atol=0.01)


def test_likelihood_learns_how_large_a_process_noise_is():
    def model(theta):
        return sp.StateSpaceModel(
            lambda x, u: theta["a"] * x, lambda x, u: x, theta["q"] * jnp.eye(1), 0.1 * jnp.eye(1),
            sp.Gaussian(jnp.zeros(1), jnp.eye(1)),
        )  # fmt: skip

    _, y = sp.simulate(model({"a": 0.9, "q": 0.3}), 1000, key=jax.random.key(3))
    theta = {"a": sp.real(0.6, 0.2), "q": sp.positive(1.5, 1.5)}
    found = sp.dual(model, theta, cost=sp.maximum_likelihood()).filter(y).estimates
    for name, truth in (("a", 0.9), ("q", 0.3)):
        assert abs(found.value[name][-1] - truth) < 3 * found.std[name][-1]
    assert found.std["q"][-1] < 0.05


@pytest.mark.parametrize("cost", [COSTS["learned"], COSTS["likelihood"]], ids=["learned", "likelihood"])
def test_online_is_the_same_as_over_a_series(cost):
    y, u = series(20)
    both = sp.dual(build, THETA, drift=sp.annealed(1e-3, 0.9), cost=cost)
    found, state = both.filter(y, u), both.init()
    for k in range(20):
        state, info = both.update(state, y[k], u[k])
        np.testing.assert_allclose(state.mean, found.post.mean[k], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(state.cov, found.post.cov[k], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(info.innovation, found.post.innovation[k], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(state.estimates.std["q"], found.estimates.std["q"][-1], rtol=1e-9)
    np.testing.assert_allclose(state.theta["a"], found.theta["a"], rtol=1e-9)
    later, _ = both.update(found.state, y[0], u[0])  # a result's state goes on
    np.testing.assert_allclose(later.mean, both.update(state, y[0], u[0])[0].mean, rtol=1e-9)


def test_epochs_go_on_with_the_parameters_and_begin_with_the_state():
    y, u = series()
    both = sp.dual(build, THETA)
    two, one = both.filter(y, u, epochs=2), both.filter(y, u)
    again = both.filter(y, u, state=one.state)
    np.testing.assert_allclose(again.post.mean, two.post.mean, rtol=1e-12)
    np.testing.assert_array_equal(two.history.mse, [*one.history.mse, *again.history.mse])
    assert two.history.log_likelihood[1] > two.history.log_likelihood[0]
    np.testing.assert_allclose(two.history.log_likelihood[1], two.post.log_likelihood)
    assert two.model.dynamics(jnp.ones(2), 0.0)[0] == one.model.dynamics(jnp.ones(2), 0.0)[0] + (
        two.theta["a"] - one.theta["a"]
    )


def test_nothing_is_compiled_twice(caplog):
    y, u = series(10)
    both = sp.dual(build, THETA)
    state = both.filter(y, u).state
    for _ in range(3):
        state, _ = both.update(state, y[0], u[0])
    with jax.log_compiles():
        both.update(state, y[1], u[1])
        both.filter(y, u, epochs=2)
    assert "Compiling" not in caplog.text
    with jax.log_compiles():  # it would have been heard
        jax.jit(lambda a: a + 1)(y)
    assert "Compiling" in caplog.text


def test_prepared_ahead_no_sample_compiles_anything(caplog):
    both, (y, u) = sp.dual(build, THETA), jax.tree.map(np.asarray, series(4))
    jax.clear_caches()
    state = both.prepare(np.zeros(2), 0.0)
    caplog.clear()
    with jax.log_compiles():
        for k in range(2):
            state, _ = both.update(state, y[k], u[k])
    assert not caplog.records
    assert int(state.step) == 2


def test_a_state_is_loaded_into_a_new_one_that_has_an_input(tmp_path):
    both, (y, u) = sp.dual(build, THETA), series(4)
    saved = both.filter(y, u).state
    sp.save(tmp_path / "state.npz", saved)
    back = sp.load(tmp_path / "state.npz", like=both.init(0.0))
    later, _ = both.update(back, y[0], u[0])
    np.testing.assert_array_equal(later.mean, both.update(saved, y[0], u[0])[0].mean)
    first = [both.update(both.init(*given), y[0], u[0])[0].theta["a"] for given in ((), (0.0,), (1e3,))]
    assert first[0] == first[1] == first[2]
    message("NaN", lambda: both.init(np.nan))


def test_under_a_transformation_the_way_out_is_named_and_works():
    both, (y, u) = sp.dual(build, THETA), series(4)

    def mean(y, u):
        return both.filter(y, u).post.mean

    for called in (jax.jit(mean), jax.jit(lambda *_: mean(y, u)), jax.vmap(mean)):
        message("Dual.filter is not for use under jax.jit", partial(called, y[None], u[None]))
    update = jax.jit(lambda state, row: (both.update(state, *row)[0], None))
    state = jax.lax.scan(update, both.init(u[0]), (y, u))[0]
    np.testing.assert_allclose(state.mean, both.filter(y, u).state.mean, rtol=1e-9)


def test_32_bits():
    def model(a):
        return sp.StateSpaceModel(
            lambda x, u: a * x, lambda x, u: x, jnp.eye(1, dtype=jnp.float32), jnp.eye(1, dtype=jnp.float32),
            sp.Gaussian(jnp.zeros(1, jnp.float32), jnp.eye(1, dtype=jnp.float32)),
        )  # fmt: skip

    _, y = sp.simulate(model(jnp.float32(0.9)), 300, key=jax.random.key(4))
    for cost in (sp.prediction_error(), sp.maximum_likelihood()):
        theta = sp.bounded(jnp.float32(0.5), jnp.float32(0.3), low=-1.0, high=1.0)
        found = sp.dual(model, theta, state_method=sp.srukf(), cost=cost).filter(y)
        assert found.post.mean.dtype == found.estimates.value.dtype == jnp.float32
        assert abs(found.theta - 0.9) < 0.1


@pytest.mark.parametrize("parameter_method", [sp.ekf(), sp.srukf()], ids=["ekf", "srukf"])
def test_parameters_of_very_different_size_are_both_found(parameter_method):
    def model(theta):
        return sp.StateSpaceModel(
            lambda x, u: 1e9 * theta["small"] * x + 1e-6 * theta["large"] * u, lambda x, u: x,
            0.01 * jnp.eye(1), 0.01 * jnp.eye(1), sp.Gaussian(jnp.zeros(1), jnp.eye(1)),
        )  # fmt: skip

    u = jnp.sin(jnp.arange(400.0) / 3.0)
    _, y = sp.simulate(model({"small": 0.8e-9, "large": 2e6}), 400, u=u, key=jax.random.key(5))
    vector = sp.Gaussian(jnp.array([0.5e-9, 1e6]), jnp.diag(jnp.array([0.09e-18, 1e12])))
    tree = {"small": sp.positive(0.5e-9, 0.3e-9), "large": sp.real(1e6, 1e6)}
    found = sp.dual(model, tree, parameter_method=parameter_method).filter(y, u).theta
    as_vector = sp.dual(lambda z: model({"small": z[0], "large": z[1]}), vector, parameter_method=parameter_method)
    for small, large in ((found["small"], found["large"]), as_vector.filter(y, u).theta):
        np.testing.assert_allclose([small * 1e9, large * 1e-6], [0.8, 2.0], rtol=0.05)


def test_an_angle_turns_past_half_a_turn():
    def model(rate, wraps=True):
        space = sp.angles(0) if wraps else None
        return sp.StateSpaceModel(
            lambda x, u: x + rate, lambda x, u: x, 1e-4 * jnp.eye(1), 1e-3 * jnp.eye(1),
            sp.Gaussian(jnp.zeros(1), 0.01 * jnp.eye(1)), state_space=space, observation_space=space,
        )  # fmt: skip

    _, y = sp.simulate(model(0.25, wraps=False), 100, key=jax.random.key(6))
    turned = jnp.mod(y + jnp.pi, 2 * jnp.pi) - jnp.pi
    found = sp.dual(model, sp.real(0.2, 0.1)).filter(turned)
    straight = sp.dual(lambda rate: model(rate, wraps=False), sp.real(0.2, 0.1)).filter(y)
    np.testing.assert_allclose(found.estimates.value, straight.estimates.value, rtol=1e-9)
    np.testing.assert_allclose(jnp.cos(found.post.mean), jnp.cos(straight.post.mean), atol=1e-9)
    assert np.abs(found.post.mean).max() <= np.pi


def test_points_of_more_numbers_than_directions_are_learned_from_as_the_angle():
    y = measured(100)
    circle, angle = (
        sp.dual(build, sp.real(0.2, 0.1)).filter(y) for build, y in ((on_circle, vector(y)), (as_angle, y))
    )
    jax.tree.map(partial(np.testing.assert_allclose, rtol=1e-8), circle.estimates, angle.estimates)
    np.testing.assert_allclose(circle.post.mean, vector(jnp.asarray(angle.post.mean)), atol=1e-8)
    assert abs(circle.theta - 0.3) < 3 * circle.estimates.std[-1] < 0.02


def test_noises_that_change_with_time_are_those_of_their_instant():
    def model(z):
        ramp = jnp.linspace(0.1, 2.0, T)[:, None, None]
        return sp.StateSpaceModel(
            lambda x, u: z[0] * x, lambda x, u: x, ramp, 3 - ramp, sp.Gaussian(jnp.ones(1), jnp.eye(1))
        )

    y, known = series()[0][:, :1], sp.Gaussian(jnp.array([0.8]), jnp.zeros((1, 1)))
    found = sp.dual(model, known).filter(y).post
    np.testing.assert_allclose(found.mean, sp.filter(model(known.mean), y).mean, rtol=1e-12)


def message(match, call):
    with pytest.raises(ValueError, match=match):
        call()


def test_what_does_not_fit_is_said():
    y, u = series(5)
    message(r"build\(theta\) must be", lambda: sp.dual(lambda t: 1, THETA))
    message(
        "state_method must not be augmented or extended",
        lambda: sp.dual(build, THETA, state_method=sp.augmented(sp.ukf())),
    )
    message(
        "state_method must not be augmented or extended",
        lambda: sp.dual(build, THETA, state_method=sp.extended_set(sp.ukf())),
    )
    message(
        "parameter_method must not be iterated", lambda: sp.dual(build, THETA, parameter_method=sp.iterated(sp.ukf()))
    )
    correlated = sp.Gaussian(jnp.ones(2), jnp.array([[1.0, 0.5], [0.5, 1.0]]))
    message("diagonal covariance", lambda: sp.dual(from_vector, correlated))
    message("noise: the variance", lambda: sp.prediction_error(-1.0))
    both = sp.dual(build, THETA)
    message("y must be one measurement", lambda: both.update(both.init(), y, u[0]))
    message("epochs must be", lambda: both.filter(y, u, epochs=0))
    message("one row for each", lambda: both.filter(y, u[:2]))
    message("infinite", lambda: both.update(both.init(), y[0].at[0].set(jnp.inf), u[0]))
