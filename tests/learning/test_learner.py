"""Laws of learning: what any method must do on problems whose answer is known."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.square_root_learning import recursive_least_squares, square_root_ukf

import sigmapoint as sp
from sigmapoint.learning import triangular

METHODS = {
    "ekf": sp.ekf(),
    "srekf": sp.srekf(),
    "ukf": sp.ukf(),
    "srukf": sp.srukf(),
    "cdkf": sp.cdkf(),
    "srcdkf": sp.srcdkf(),
}
ALL = pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
ROOTS = pytest.mark.parametrize("method", [METHODS[name] for name in ("srekf", "srukf", "srcdkf")], ids=str)


def linear(L, N, seed=0):
    r = np.random.default_rng(seed)
    x = r.normal(size=(N, L))
    return x, x @ r.normal(size=L) + 0.1 * r.normal(size=N)


def network(L_hidden=3, outputs=2, seed=0):
    r = np.random.default_rng(seed)
    w = {"in": r.normal(size=(L_hidden, 3)), "out": r.normal(size=(outputs, L_hidden + 1))}

    def g(w, x):
        hidden = jnp.tanh(w["in"] @ jnp.append(x, 1.0))
        return w["out"] @ jnp.append(hidden, 1.0)

    return g, jax.tree.map(jnp.asarray, w)


def states(learner, x, d):
    s = learner.init()
    out = []
    for pair in zip(x, d):
        s, _ = learner.update(s, *pair)
        out.append(s)
    return out


@ALL
@pytest.mark.parametrize("L", [1, 7, 70])
def test_linear_models_with_forgetting_are_recursive_least_squares(method, L):
    x, d = linear(L, 2 * L + 10)
    learner = sp.learner(
        lambda w, x: w @ x, jnp.zeros(L), noise=0.01, method=method, drift=sp.forgetting(0.98), prior_std=3.0
    )
    found = states(learner, x, d)
    means, P = recursive_least_squares(x, d, np.zeros(L), 9 * np.eye(L), 0.01, 0.98)
    np.testing.assert_allclose([s.mean for s in found], means, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(found[-1].cov, P, atol=1e-10 * np.abs(P).max())
    np.testing.assert_allclose(found[-1].std, np.sqrt(np.diag(P)), rtol=1e-9)


@pytest.mark.parametrize("method", [sp.ekf(), sp.srekf()], ids=["ekf", "srekf"])
@pytest.mark.parametrize("hidden", [3, 12])
def test_the_extended_filter_is_the_textbooks(method, hidden):
    g, w0 = network(hidden)
    flat, unravel = jax.flatten_util.ravel_pytree(w0)
    f = jax.jit(lambda v, x: g(unravel(v), x))
    slope = jax.jit(jax.jacfwd(f))
    r = np.random.default_rng(3)
    x, d = r.normal(size=(30, 2)), r.normal(size=(30, 2))
    found = states(sp.learner(g, w0, noise=0.05, method=method, drift=sp.forgetting(0.99), prior_std=0.3), x, d)
    w, P = np.asarray(flat), 0.09 * np.eye(len(flat))
    for a, b in zip(x, d):
        P, H = P / 0.99, np.asarray(slope(w, a))
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + 0.05 * np.eye(2))
        w, P = w + K @ (b - np.asarray(f(w, a))), P - K @ H @ P
    np.testing.assert_allclose(found[-1].mean, w, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found[-1].cov, P, rtol=1e-7, atol=1e-10)


@pytest.mark.parametrize("rule", ["ukf", "cdkf"])
@pytest.mark.parametrize("hidden", [3, 12])
def test_square_root_and_dense_agree(rule, hidden):
    g, w = network(hidden)
    r = np.random.default_rng(1)
    x, d = r.normal(size=(30, 2)), r.normal(size=(30, 2))
    dense, root = (
        states(sp.learner(g, w, noise=0.05, method=METHODS[m], drift=sp.fixed(1e-4), prior_std=0.3), x, d)
        for m in (rule, "sr" + rule)
    )
    np.testing.assert_allclose([s.mean for s in root], [s.mean for s in dense], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(root[-1].cov, dense[-1].cov, rtol=1e-8, atol=1e-10)
    assert (jnp.triu(root[-1].factor, 1) == 0).all()


def test_it_is_the_papers_algorithm_without_its_downdates():
    g, w = network()
    flat, unravel = jax.flatten_util.ravel_pytree(w)
    r = np.random.default_rng(2)
    x, d = r.normal(size=(40, 2)), r.normal(size=(40, 2))
    learner = sp.learner(g, w, noise=0.05, method=sp.srukf(), drift=sp.forgetting(0.99), prior_std=0.3)
    found = states(learner, x, d)
    f = jax.jit(lambda v, x: g(unravel(v), x))
    means, factors = square_root_ukf(
        f, np.asarray(flat), 0.3 * np.eye(len(flat)), list(zip(x, d)), 0.05 * np.eye(2), 0.99
    )
    np.testing.assert_allclose([s.mean for s in found], means, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found[-1].factor, factors[-1] * np.sign(np.diag(factors[-1])), rtol=1e-7, atol=1e-9)


@ALL
@pytest.mark.parametrize(
    "drift",
    [sp.fixed(1e-3), sp.annealed(1e-2, 0.9, floor=1e-5), sp.forgetting(0.97), sp.robbins_monro(1e-3, 0.1)],
    ids=["fixed", "annealed", "forgetting", "robbins monro"],
)
def test_drifts_are_the_same_in_both_forms_and_keep_correlations(method, drift):
    x, d = linear(4, 20)
    learner = sp.learner(lambda w, x: w @ x, jnp.zeros(4), noise=0.01, method=method, drift=drift, prior_std=2.0)
    w, P, memory = np.zeros(4), 4 * np.eye(4), drift.start(jnp.full(4, 4.0))
    for k, (a, b) in enumerate(zip(x, d)):
        added = np.asarray(drift.added(memory, jnp.diag(jnp.asarray(P)), jnp.asarray(k)))
        scale = np.sqrt(1 + added / np.diag(P))
        P = P * np.outer(scale, scale)
        gain = P @ a / (a @ P @ a + 0.01)
        moved = gain * (b - a @ w)
        w, P, memory = w + moved, P - np.outer(gain, a @ P), drift.after(memory, jnp.asarray(moved))
    s = states(learner, x, d)[-1]
    np.testing.assert_allclose(s.mean, w, rtol=1e-9)
    np.testing.assert_allclose(s.cov, P, rtol=1e-7, atol=1e-10)


def test_the_papers_additive_drift():
    x, d = linear(3, 5)
    common = {"noise": 0.01, "drift": sp.on_diagonal(sp.fixed(0.1)), "prior_std": 1.0}
    dense, root = (sp.learner(lambda w, x: w @ x, jnp.zeros(3), method=m, **common) for m in (sp.ukf(), sp.srukf()))
    s = states(dense, x, d)[-1]
    grown = dense.setup.drift.inflated(s.uncertainty, jnp.full(3, 0.1))
    np.testing.assert_allclose(grown.cov, s.cov + 0.1 * np.eye(3))
    s = states(root, x, d)[-1]
    grown = root.setup.drift.inflated(s.uncertainty, jnp.full(3, 0.1))
    D = np.sqrt(np.diag(s.factor) ** 2 + 0.1) - np.diag(s.factor)
    np.testing.assert_allclose(grown.factor, s.factor + np.diag(D))
    np.testing.assert_allclose(grown.variance, np.diag(grown.cov), rtol=1e-12)


@ALL
def test_what_is_known_exactly_stays_and_a_drift_can_wake_it(method):
    std = jnp.array([0.0, 1.0])
    learner = sp.learner(lambda w, x: w @ x, jnp.array([5.0, 0.0]), noise=0.1, method=method, prior_std=std)
    s, _ = learner.update(learner.init(), np.ones(2), 7.0)
    assert float(s.mean[0]) == 5.0
    assert float(s.std[0]) == 0.0
    learner = sp.learner(
        lambda w, x: w @ x, jnp.array([5.0, 0.0]), noise=0.1, method=method, drift=sp.fixed(1.0), prior_std=std
    )
    s, _ = learner.update(learner.init(), np.ones(2), 7.0)
    P = np.diag([1.0, 2.0])
    np.testing.assert_allclose(s.cov, P - P @ np.ones((2, 2)) @ P / 3.1, rtol=1e-12)


@ALL
def test_unknown_targets_teach_nothing(method):
    g, w = network()
    learner = sp.learner(g, w, noise=np.array([0.1, 0.2]), method=method)
    s, info = learner.update(learner.init(), np.ones(2), np.full(2, np.nan))
    np.testing.assert_allclose(s.mean, learner.init().mean)
    np.testing.assert_allclose(s.cov, np.eye(len(s.mean)), atol=1e-12)
    assert float(info.nis) == 0.0
    assert float(info.log_likelihood) == 0.0
    half, _ = learner.update(learner.init(), np.ones(2), np.array([np.nan, 1.0]))
    one = sp.learner(lambda w, x: g(w, x)[1:], w, noise=0.2, method=method)
    whole, _ = one.update(one.init(), np.ones(2), np.array([1.0]))
    np.testing.assert_allclose(half.mean, whole.mean, rtol=1e-9, atol=1e-12)


@ALL
def test_a_batch_of_a_linear_model_is_its_pairs_one_by_one(method):
    x, d = linear(5, 12)
    learner = sp.learner(lambda w, x: w @ x, jnp.zeros(5), noise=0.01, method=method)
    one = states(learner, x, d)[-1]
    batch, info = learner.update_batch(learner.init(), x, d)
    np.testing.assert_allclose(batch.mean, one.mean, rtol=1e-9)
    np.testing.assert_allclose(batch.cov, one.cov, atol=1e-11)
    assert info.prediction.shape == (12,)


@ROOTS
def test_a_large_batch_through_several_blocks_of_the_factor(method):
    L = 130
    x, d = linear(L, 60)
    learner = sp.learner(lambda w, x: w @ x, jnp.zeros(L), noise=0.01, method=method)
    s, _ = learner.update_batch(learner.init(), x, d)
    P = np.linalg.inv(np.eye(L) + x.T @ x / 0.01)
    np.testing.assert_allclose(s.cov, P, atol=1e-10)
    np.testing.assert_allclose(s.mean, P @ x.T @ d / 0.01, rtol=1e-8, atol=1e-9)
    assert (jnp.triu(s.factor, 1) == 0).all()


@ROOTS
@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64], ids=["float32", "float64"])
def test_a_precise_target_under_a_wide_prior_does_not_break_it(method, dtype):
    """The case at which the papers' downdate fails at the first sample."""
    learner = sp.learner(lambda w, x: w @ x, jnp.zeros(6, dtype), noise=1e-10, method=method, prior_std=1e4)
    r = np.random.default_rng(0)
    s = learner.init()
    for _ in range(50):
        a = r.normal(size=6)
        s, info = learner.update(s, a, a.sum())
        assert jnp.isfinite(s.mean).all()
        assert jnp.isfinite(info.log_likelihood)
        assert (jnp.diagonal(s.factor) >= 0).all()
    np.testing.assert_allclose(s.mean, 1.0, rtol=1e-2 if dtype == jnp.float32 else 1e-6)


@ALL
@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64], ids=["float32", "float64"])
def test_no_variance_is_negative_however_long_it_learns(method, dtype):
    """Exact targets, one input that is never there: 2,000 updates under a wide prior."""
    r = np.random.default_rng(0)
    x = (r.normal(size=(2000, 6)) * [1, 1, 1, 0, 1e-3, 1]).astype(dtype)
    learner = sp.learner(
        lambda w, x: w @ x, jnp.zeros(6, dtype), noise=1e-4, method=method, drift=sp.forgetting(0.99), prior_std=100.0
    )
    s, info = jax.lax.scan(lambda s, p: learner.update(s, *p), learner.init(), (x, x.sum(1)))
    assert jnp.isfinite(info.log_likelihood).all()
    assert (jnp.linalg.eigvalsh(s.cov) >= -1e-6 * s.std.max() ** 2).all()
    assert (s.std > 0).all()
    np.testing.assert_allclose(s.mean[jnp.array([0, 1, 2, 5])], 1.0, atol=0.01)


def test_forgetting_stops_where_nothing_is_learned():
    learner = sp.learner(lambda w, x: w @ x, jnp.zeros(2), noise=0.1, drift=sp.forgetting(0.9), prior_std=2.0)
    x = np.stack([np.ones(500), np.zeros(500)], 1)
    s, _ = jax.lax.scan(lambda s, p: learner.update(s, *p), learner.init(), (x, np.ones(500)))
    np.testing.assert_allclose(s.std[1], 2000.0, rtol=1e-9)


def test_learned_noise_recovers_from_targets_without_noise():
    learner = sp.learner(lambda w, x: w * x, 0.0, noise=sp.learned_noise(1.0, 0.1), drift=sp.fixed(1e-4))
    d = np.append(np.zeros(5000), 5 + np.random.default_rng(0).normal(size=2000))
    s, _ = jax.lax.scan(lambda s, p: learner.update(s, *p), learner.init(), (np.ones(7000), d))
    np.testing.assert_allclose(s.mean, 5.0, atol=0.3)
    assert 0.3 < float(s.noise) < 3


@ALL
def test_states_of_many_learners_at_once(method):
    learner = sp.learner(lambda w, x: w @ x, jnp.zeros(3), noise=0.1, method=method)
    x, d = np.random.default_rng(0).normal(size=(3, 3)), np.ones(3)
    many, _ = jax.vmap(lambda x, d: learner.update(learner.init(), x, d))(x, d)
    for i in range(3):
        one, _ = learner.update(learner.init(), x[i], d[i])
        np.testing.assert_allclose(many.cov[i], one.cov, atol=1e-12)
        np.testing.assert_allclose(many.factor[i], one.factor, atol=1e-12)
        np.testing.assert_allclose(many.std[i], one.std, atol=1e-12)


def test_a_gap_in_the_data_does_not_calm_the_drift():
    learner = sp.learner(lambda w, x: w * x, 0.0, noise=0.1, drift=sp.robbins_monro(0.01, 0.5))
    s, _ = learner.update(learner.init(), 1.0, np.nan)
    np.testing.assert_array_equal(s.drift, 0.01)
    s, _ = learner.update(s, 1.0, 0.0)
    assert float(s.drift[0]) != 0.01


def test_a_learner_may_be_made_where_it_is_compiled():
    def slope(std):
        learner = sp.learner(lambda w, x: w * x, 0.0, noise=0.1, prior_std=std)
        return learner.update(learner.init(), 1.0, 1.0)[0].mean[0]

    np.testing.assert_allclose(jax.jit(slope)(2.0), slope(2.0), rtol=1e-12)
    np.testing.assert_allclose(jax.grad(slope)(2.0), 2 * 2.0 * 0.1 / (4 + 0.1) ** 2, rtol=1e-9)


def test_deviations_may_come_as_a_module_and_numbers_take_the_type_of_arrays():
    net = eqx.nn.MLP(2, 1, 4, 1, key=jax.random.key(0), dtype=jnp.float32)
    std = jax.tree.map(lambda a: 0.5 if eqx.is_array(a) else a, net)
    s = sp.learner(lambda net, x: net(x), net, noise=0.1, prior_std=std).init()
    np.testing.assert_array_equal(s.std, 0.5)
    both = sp.learner(lambda w, x: w["a"] * x + w["b"].sum(), {"a": 1.0, "b": jnp.ones(2, jnp.float32)}, noise=0.1)
    assert both.init().mean.dtype == jnp.float32


def test_equinox_modules_are_trained_where_they_have_arrays():
    net = eqx.nn.MLP(2, 1, 4, 1, activation=jnp.tanh, key=jax.random.key(0), dtype=jnp.float64)
    learner = sp.learner(lambda net, x: net(x), net, noise=0.1)
    s, _ = learner.update(learner.init(), np.ones(2), np.ones(1))
    assert isinstance(learner.params(s), eqx.nn.MLP)
    assert learner.params(s)(jnp.ones(2)).shape == (1,)
    assert learner.predict(s, np.ones(2)).std.shape == (1,)


def test_noise_is_learned_in_the_form_it_is_given():
    r = np.random.default_rng(0)
    x = r.normal(size=(4000, 2))
    d = x @ np.array([[1.0, 2.0], [-1.0, 0.5]]) + r.normal(size=(4000, 2)) @ np.diag([0.3, 1.2])
    for start, expected in (
        (1.0, (0.09 + 1.44) / 2),
        (np.ones(2), np.array([0.09, 1.44])),
        (np.eye(2), np.diag([0.09, 1.44])),
    ):
        noise = sp.learned_noise(start, rate=0.002)
        fit = sp.learn(lambda w, x: x @ w, jnp.zeros((2, 2)), x, d, noise=noise, key=1)
        np.testing.assert_allclose(fit.state.noise, expected, rtol=0.1, atol=0.05)


def test_error_bars_of_predictions():
    """Of a line through few points: as of linear regression."""
    x = np.array([0.0, 1.0, 2.0])
    line = sp.learner(lambda w, x: w[0] + w[1] * x, jnp.zeros(2), noise=0.04, prior_std=10.0)
    s = states(line, x, 2 - x)[-1]
    A = np.stack([np.ones(3), x], 1)
    P = np.linalg.inv(A.T @ A / 0.04 + np.eye(2) / 100)
    mean, std = line.predict(s, 5.0)
    np.testing.assert_allclose(std, np.sqrt(np.array([1, 5]) @ P @ np.array([1, 5])), rtol=1e-9)
    np.testing.assert_allclose(mean, np.array([1, 5]) @ P @ A.T @ (2 - x) / 0.04, rtol=1e-9)


def test_the_value_at_the_mean_as_prediction():
    learner = sp.learner(lambda w, x: w**2, 1.0, noise=0.1, method=sp.at_mean(sp.srukf()), prior_std=0.5)
    _, info = learner.update(learner.init(), 0.0, 1.0)
    np.testing.assert_allclose(info.prediction, 1.0)
    same = sp.learner(lambda w, x: w**2, 1.0, noise=0.1, method=sp.at_mean(sp.ekf()), prior_std=0.5)
    assert same.setup.method == sp.ekf()
    plain = sp.learner(lambda w, x: w**2, 1.0, noise=0.1, method=sp.srukf(), prior_std=0.5)
    np.testing.assert_allclose(plain.update(plain.init(), 0.0, 1.0)[1].prediction, 1.25)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"w0": {}}, "no parameters"),
        ({"w0": jnp.array([np.nan])}, "w0"),
        ({"w0": [jnp.zeros(1), jnp.zeros(1, jnp.float32)]}, "one floating-point type"),
        ({"noise": 0.0}, "greater than zero"),
        ({"noise": -1.0}, "greater than zero"),
        ({"prior_std": -1.0}, "not negative"),
        ({"prior_std": jnp.ones(3)}, "does not fit"),
        ({"method": sp.iterated(sp.srukf(), 2)}, "iterated"),
        ({"method": sp.augmented(sp.srukf())}, "augmented"),
    ],
    ids=lambda v: "" if isinstance(v, str) else next(iter(v)),
)
def test_bad_settings(change, message):
    with pytest.raises(ValueError, match=message):
        sp.learner(**({"function": lambda w, x: w, "w0": jnp.zeros(2), "noise": 1.0} | change))


@pytest.mark.parametrize(
    ("x", "d", "message"),
    [
        (np.ones(2), np.ones(3), "target has shape"),
        (np.array([1.0, np.nan]), 1.0, "inputs"),
        (np.ones(2), np.inf, "infinite"),
        (np.ones(2), 1j, "real"),
        (np.ones(2), np.ma.masked_invalid([np.nan])[0:1].reshape(()), "masked"),
    ],
)
def test_bad_pairs(x, d, message):
    learner = sp.learner(lambda w, x: w @ x, jnp.zeros(2), noise=1.0)
    with pytest.raises(ValueError, match=message):
        learner.update(learner.init(), x, d)


@pytest.mark.parametrize(
    ("method", "dtype"),
    [
        pytest.param(sp.srukf(), jnp.float32, marks=pytest.mark.slow),
        (sp.srcdkf(), jnp.float32),
        pytest.param(sp.srcdkf(), jnp.float64, marks=pytest.mark.slow),
        (sp.srekf(), jnp.float64),
    ],
    ids=["srukf-32", "srcdkf-32", "srcdkf-64", "srekf-64"],
)
def test_a_factor_stays_one_for_a_hundred_thousand_updates(method, dtype):
    L, N, epochs = 5, 100, 1000
    x, d = linear(L, N)
    fit = sp.learn(
        lambda w, x: x @ w, jnp.zeros(L, dtype), x, d, noise=0.01, method=method, drift=sp.forgetting(0.999),
        prior_std=3.0, epochs=epochs,
    )  # fmt: skip
    S = np.asarray(fit.state.factor)
    assert S.dtype == dtype
    assert int(fit.state.step) == N * epochs
    np.testing.assert_array_equal(S, np.tril(S))
    assert (np.diag(S) > 0).all()
    # Forgetting leaves the sum over the past, which is periodic.
    weights = 0.999 ** np.arange(20 * N)[::-1]
    past = np.tile(x, (20, 1))
    information = (past * weights[:, None]).T @ past / 0.01 / (1 - 0.999 ** (20 * N))
    rtol = 2e-3 if dtype == jnp.float32 else 1e-9
    np.testing.assert_allclose(np.linalg.inv(S.astype(float) @ S.T), information, rtol=rtol, atol=rtol * 1e4)


@pytest.mark.parametrize("scale", [1.0, 1e-9, 1e9])
@pytest.mark.parametrize("targets", [1, 2, 4])
def test_a_block_is_turned_in_closed_form_as_by_reflections(targets, scale):
    r = np.random.default_rng(targets)
    C = jnp.asarray(np.tril(r.normal(size=(targets, targets)), -1) + np.diag(1 + r.random(targets)))
    phi = jnp.asarray(scale * r.normal(size=(targets, 9))).at[:, 3].set(0.0)
    closed, reflected = triangular._row_by_row(C, phi), triangular._by_reflections(C, phi)
    for one, other in zip(closed, reflected):
        # How far rows of C and Φ are from each other in size is how far Q may move by round-off.
        np.testing.assert_allclose(one, other, atol=1e-13 * max(scale, float(jnp.abs(other).max())))
    Q = closed[1]
    np.testing.assert_allclose(Q @ Q.T, np.eye(9 + targets), atol=1e-14)
    corner = Q[targets:, targets:].T
    np.testing.assert_array_equal(corner, jnp.tril(corner))


def test_nothing_seen_turns_nothing():
    C, Q = triangular._row_by_row(jnp.zeros((1, 1)), jnp.zeros((1, 3)))
    np.testing.assert_array_equal(C, 0.0)
    np.testing.assert_array_equal(Q, np.eye(4))
