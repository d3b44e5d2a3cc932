"""Laws of what is learned: functions with a memory, residuals, classes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.square_root_learning import recursive_least_squares

import sigmapoint as sp

METHODS = {"ekf": sp.ekf(), "ukf": sp.ukf(), "srukf": sp.srukf(), "srcdkf": sp.srcdkf()}
ALL = pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)


def learned(learner, x, d):
    s = learner.init()
    for pair in zip(x, d):
        s, info = learner.update(s, *pair)
    return s, info


def series(T, seed=0):
    r = np.random.default_rng(seed)
    return r.normal(size=(T, 2)), r.normal(size=T)


def leaky(w, h, x):
    """An Elman cell of three units."""
    h = jnp.tanh(w["own"] @ h + w["in"] @ x)
    return h, w["out"] @ h


def cell_parameters(seed=1):
    r = np.random.default_rng(seed)
    shapes = {"own": (3, 3), "in": (3, 2), "out": (3,)}
    return {name: jnp.asarray(0.5 * r.normal(size=shape)) for name, shape in shapes.items()}


@ALL
def test_a_memory_that_is_linear_in_the_parameters_is_least_squares(method):
    # h sums up w·x: the prediction is w·(x₁ + … + x_k), whatever w was when the x came.
    def summed(w, h, x):
        h = h + w @ x
        return h, h

    x, d = series(20)
    s, _ = learned(sp.learner(sp.recurrent(summed, 0.0), np.zeros(2), noise=0.1, method=method), x, d)
    total = np.cumsum(x, axis=0)
    means, P = recursive_least_squares(total, d, np.zeros(2), np.eye(2), 0.1, 1.0)
    np.testing.assert_allclose(s.mean, means[-1], rtol=1e-10)
    np.testing.assert_allclose(s.cov, P, rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(s.memory.mean, total[-1] @ s.mean, rtol=1e-10)  # it has moved with the parameters
    np.testing.assert_allclose(s.memory.slope[0], total[-1], rtol=1e-9)


@ALL
def test_the_memorys_slope_is_its_derivative_through_time(method):
    x, _ = series(15)
    w, cell = cell_parameters(), sp.recurrent(leaky, np.zeros(3))
    learner = sp.learner(cell, w, noise=1.0, method=method, prior_std=1e-4)
    s, _ = learned(learner, x, np.full(15, np.nan))  # nothing is learned
    flat, unravel = jax.flatten_util.ravel_pytree(w)

    def last(v):
        return jax.lax.scan(lambda h, a: (leaky(unravel(v), h, a)[0], None), jnp.zeros(3), jnp.asarray(x))[0]

    np.testing.assert_allclose(s.memory.mean, last(flat), rtol=1e-6)
    np.testing.assert_allclose(s.memory.slope, jax.jacfwd(last)(flat), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("method", [METHODS["ekf"], METHODS["srcdkf"]], ids=["ekf", "srcdkf"])
def test_a_series_at_once_is_a_function_of_the_series(method):
    x, d = series(6)
    w = cell_parameters()
    s = sp.learner(sp.recurrent(leaky, np.zeros(3)), w, noise=0.1, method=method)
    found, _ = s.update_batch(s.init(), x, d)

    def whole(w, x):
        return jax.lax.scan(lambda h, a: leaky(w, h, a), jnp.zeros(3), x)[1]

    one = sp.learner(whole, w, noise=0.1, method=method)
    expected, _ = one.update(one.init(), x, d)
    np.testing.assert_allclose(found.mean, expected.mean, rtol=1e-9)
    np.testing.assert_allclose(found.cov, expected.cov, rtol=1e-8, atol=1e-12)


def test_every_epoch_begins_without_memory_and_predictions_go_on_from_the_last():
    x, d = series(8)
    lag = sp.recurrent(lambda w, h, x: (0.5 * h + x[0], w * (0.5 * h + x[0])), 0.0)
    fit = sp.learn(lag, 1.0, x, d, noise=0.1, epochs=2)
    h = 0.0
    for a in x:
        h = 0.5 * h + a[0]
    np.testing.assert_allclose(fit.state.memory.mean, h, rtol=1e-12)
    np.testing.assert_allclose(fit.predict(x[0]).mean, fit.params * (0.5 * h + x[0, 0]), rtol=1e-12)
    twice = sp.learner(lag, 1.0, noise=0.1)
    s = twice.init()
    for _ in range(2):
        s = s._replace(memory=twice.setup.initial_memory)
        for pair in zip(x, d):
            s, _ = twice.update(s, *pair)
    np.testing.assert_allclose(fit.state.mean, s.mean, rtol=1e-11)


def test_a_series_is_not_shuffled():
    x, d = series(8)
    for wrong in ({"key": 0}, {"batch": 3}):
        with pytest.raises(ValueError, match="in order and in whole batches"):
            sp.learn(sp.recurrent(leaky, np.zeros(3)), cell_parameters(), x, d, noise=1.0, **wrong)


def test_a_memory_keeps_its_shape():
    grows = sp.learner(sp.recurrent(lambda w, h, x: (jnp.append(h, x), w * x), np.zeros(1)), 1.0, noise=1.0)
    with pytest.raises(ValueError, match="memory like h0"):
        grows.update(grows.init(), 1.0, 1.0)
    alone = sp.learner(sp.recurrent(lambda w, h, x: w * h, 0.0), 1.0, noise=1.0)
    with pytest.raises(ValueError, match=r"must return \(memory like h0, prediction\)"):
        alone.update(alone.init(), 1.0, 1.0)


@ALL
def test_the_residual_of_a_function_is_that_function(method):
    x, d = series(12)

    def g(w, x):
        return jnp.tanh(w["in"] @ x) @ w["out"]

    w = {name: value for name, value in cell_parameters().items() if name != "own"}
    direct, _ = learned(sp.learner(g, w, noise=0.1, method=method), x, d)
    residual = sp.residual(lambda w, x, d: g(w, x) - d, predict=g)
    one = sp.learner(residual, w, noise=0.1, method=method)
    found, info = learned(one, x, d)
    np.testing.assert_allclose(found.mean, direct.mean, rtol=1e-10)
    assert info.prediction.shape == (1,)
    plain = sp.learner(g, w, noise=1.0, method=sp.at_mean(method))
    np.testing.assert_allclose(one.predict(found, x[0]).mean, plain.predict(found, x[0]).mean)


def test_training_goes_down_the_residual():
    x, d = series(60)
    fit = sp.learn(
        sp.residual(lambda w, x, d: jnp.stack([x["a"] @ w - d["b"], 0.1 * w[0]])), np.zeros(2), {"a": x},
        {"b": x @ np.array([1.0, -2.0])}, noise=1e-2, epochs=3, key=0, validation=({"a": x}, {"b": 0 * d}),
    )  # fmt: skip
    assert fit.history.mse[-1] < fit.history.mse[0]
    np.testing.assert_allclose(fit.params, [1.0, -2.0], atol=0.05)


@pytest.mark.parametrize("label", [0, 1, 2])
def test_cross_entropy_is_minus_the_logarithm_of_the_probability(label):
    e = sp.cross_entropy(lambda w, x: w)
    z = jnp.array([0.3, -1.2, 2.0])

    def half_square(z):
        return 0.5 * e.error(z, None, label) ** 2

    np.testing.assert_allclose(half_square(z), -jax.nn.log_softmax(z)[label], rtol=1e-14)
    np.testing.assert_allclose(jax.grad(half_square)(z), jax.nn.softmax(z) - np.eye(3)[label], rtol=1e-12)


@pytest.mark.parametrize("gap", [-2000.0, -700.0, -40.0, 0.0, 40.0, 2000.0])
def test_cross_entropy_and_its_slope_are_finite_and_exact_far_out(gap):
    e = sp.cross_entropy(lambda w, x: jnp.stack([w, jnp.zeros(())]))
    value, slope = jax.value_and_grad(lambda w: e.error(w, None, 0))(gap)
    assert np.isfinite(slope)
    expected = np.sqrt(2 * np.logaddexp(0.0, -gap))
    np.testing.assert_allclose(value, expected, rtol=1e-12, atol=1e-160)


def test_classes_are_learned_and_told_as_probabilities():
    r = np.random.default_rng(0)
    x = r.normal(size=(300, 2))
    label = np.where(x[:, 0] > 0.3, 2, np.where(x[:, 1] > 0, 1, 0))
    fit = sp.learn(
        sp.cross_entropy(lambda w, x: w @ jnp.append(x, 1.0)), np.zeros((3, 3)), x, label, noise=1.0, prior_std=5.0,
        epochs=2, key=0,
    )  # fmt: skip
    chances = np.array([fit.predict(a).mean for a in x])
    np.testing.assert_allclose(chances.sum(1), 1.0, rtol=1e-9)
    assert (chances.argmax(1) == label).mean() > 0.9


def test_classes_may_be_true_and_false_and_logits_are_one_for_each():
    e = sp.cross_entropy(lambda w, x: w)
    np.testing.assert_array_equal(e.error(jnp.arange(2.0), None, True), e.error(jnp.arange(2.0), None, 1))
    with pytest.raises(ValueError, match=r"logits must have shape \(K,\)"):
        e.error(jnp.ones((3, 1)), None, 0)


def test_a_class_that_does_not_exist_is_not_another():
    e = sp.cross_entropy(lambda w, x: w)
    assert np.isnan(e.error(jnp.zeros(3), None, 3))
    assert np.isnan(e.error(jnp.zeros(3), None, -1))


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: sp.recurrent(leaky, ()), "h0 must hold at least one number"),
        (lambda: sp.recurrent(leaky, np.array([np.nan])), "h0"),
    ],
)
def test_what_is_no_objective_is_said(make, match):
    with pytest.raises(ValueError, match=match):
        make()


def test_a_residual_alone_predicts_nothing():
    one = sp.learner(sp.residual(lambda w, x, d: w - d), 0.0, noise=1.0)
    with pytest.raises(ValueError, match="predict="):
        one.predict(one.init(), 1.0)


def test_probabilities_stay_in_range_before_anything_is_learned():
    r = np.random.default_rng(0)
    w = {"out": 2 * r.normal(size=12), "bias": jnp.zeros(())}
    one = sp.learner(
        sp.cross_entropy(lambda w, x: jnp.stack([0 * x[0], w["out"] @ x, w["bias"] - w["out"] @ x])), w, noise=1.0,
        prior_std=2.0,
    )  # fmt: skip
    chances = jax.vmap(lambda x: one.predict(one.init(), x).mean)(jnp.asarray(r.normal(size=(50, 12))))
    assert ((chances >= 0) & (chances <= 1)).all()


def test_labels_may_be_traced_and_one_hot_is_refused():
    one = sp.learner(sp.cross_entropy(lambda w, x: w @ x), np.zeros((3, 2)), noise=1.0)
    x, label = np.ones((4, 2)), np.array([0, 1, 2, 1])
    scanned, _ = jax.lax.scan(lambda s, pair: one.update(s, *pair), one.init(), (x, label))
    stepped, _ = learned(one, x, label)
    np.testing.assert_allclose(scanned.mean, stepped.mean, rtol=1e-12)
    with pytest.raises(ValueError, match="one-hot"):
        one.update(one.init(), x[0], np.array([0, 1, 0]))
    with pytest.raises(ValueError, match="A residual needs its targets"):
        one.update(one.init(), x[0], np.nan)
