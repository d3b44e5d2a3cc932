"""filter = online = a row of vmap = the same after saving and loading; missing rows only predict."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from laws.table import METHODS
from oracles.models import problems, simulate

import sigmapoint as sp

P = problems(jnp)["coordinated_turn"]
MODEL = sp.StateSpaceModel(P.f, P.h, P.Q, P.R, sp.Gaussian(P.m0, P.P0))
Y = simulate(problems(np)["coordinated_turn"], 0)[1]
SOME = ["ekf", "ukf", "sr cdkf", "sr augmented", "extended set"]
ONLINE = [
    "ekf",
    pytest.param("ukf", marks=pytest.mark.slow),
    "sr cdkf",
    "sr augmented",
    pytest.param("extended set", marks=pytest.mark.slow),
]


@pytest.mark.parametrize("name", ONLINE)
def test_online_is_filter(name):
    live, whole = sp.online(MODEL, METHODS[name]), sp.filter(MODEL, Y[:20], None, METHODS[name])
    state = ahead = live.init()
    for k in range(20):
        stepped, seen, ahead = live.step(ahead, Y[k])
        state, info = live.update(state, Y[k])
        for one, other in zip(jax.tree.leaves((stepped, seen)), jax.tree.leaves((state, info))):
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(state.mean, whole.mean[k], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(state.cov, whole.cov[k], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(info.nis, whole.nis[k], rtol=1e-12, atol=1e-12)
        state = live.predict(state)
        np.testing.assert_allclose(ahead.mean, state.mean, rtol=1e-12, atol=1e-12)
        assert int(ahead.step) == int(state.step) == k + 1


@pytest.mark.parametrize("name", SOME)
def test_saved_loaded_and_continued_is_uninterrupted(name, tmp_path):
    live = sp.online(MODEL, METHODS[name])

    def run(state, rows):
        for row in rows:
            state = live.predict(live.update(state, row)[0])
        return state

    half = run(live.init(), Y[:5])
    sp.save(tmp_path / "state.npz", half)
    resumed = run(sp.load(tmp_path / "state.npz", like=live.init()), Y[5:10])
    for a, b in zip(jax.tree.leaves(resumed), jax.tree.leaves(run(half, Y[5:10]))):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", [pytest.param("ukf", marks=pytest.mark.slow), "sr cdkf"])
def test_a_row_of_vmap_is_a_single_run(name):
    batch, method = np.stack([Y, Y[::-1], np.full_like(Y, np.nan)]), METHODS[name]
    together = jax.vmap(lambda y: sp.filter(MODEL, y, None, method))(jnp.asarray(batch))
    smoothed = jax.vmap(lambda y: sp.smooth(MODEL, y, None, method).mean)(jnp.asarray(batch))
    for i, y in enumerate(batch):
        alone = sp.filter(MODEL, y, None, method)
        np.testing.assert_allclose(together.mean[i], alone.mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(together.log_likelihood[i], alone.log_likelihood, rtol=1e-10)
    np.testing.assert_allclose(smoothed[0], sp.smooth(MODEL, Y, None, method).mean, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", SOME)
def test_missing_rows_only_predict(name):
    live, state = sp.online(MODEL, METHODS[name]), None
    whole = sp.filter(MODEL, np.full((6, 2), np.nan), None, METHODS[name])
    state = live.init()
    for k in range(6):
        np.testing.assert_allclose(whole.mean[k], state.mean, rtol=1e-12)
        np.testing.assert_allclose(whole.cov[k], state.cov, rtol=1e-9, atol=1e-12)
        state = live.predict(state)
    assert float(whole.log_likelihood) == 0
    assert np.isnan(whole.innovation).all()
    assert (whole.nis == 0).all()


def test_updates_may_come_from_different_sensors_at_any_rate():
    """Two sensors in turn, in one row or in two, give one answer where they are independent and linear."""
    model = sp.StateSpaceModel(
        lambda x, u: 0.9 * x,
        lambda x, u: x,
        0.1 * jnp.eye(2),
        jnp.diag(jnp.array([0.3, 0.7])),
        sp.Gaussian(jnp.zeros(2), jnp.eye(2)),
    )
    live = sp.online(model, sp.srcdkf())
    together, _ = live.update(live.init(), [1.0, -2.0])
    one, _ = live.update(live.init(), [1.0, jnp.nan])
    two, _ = live.update(one, [jnp.nan, -2.0])
    np.testing.assert_allclose(two.mean, together.mean, rtol=1e-13)
    np.testing.assert_allclose(two.cov, together.cov, rtol=1e-13, atol=1e-16)
    again = live.predict(live.predict(two))
    assert int(again.step) == 2


def test_second_call_compiles_nothing():
    calls = 0

    def f(x, u):
        nonlocal calls
        calls += 1
        return 0.5 * x

    model = sp.StateSpaceModel(f, lambda x, u: x, jnp.eye(1), jnp.eye(1), sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
    sp.filter(model, np.ones((5, 1)), None, sp.srukf())
    traced = calls
    sp.filter(model, np.zeros((5, 1)), None, sp.srukf())
    assert traced > 0
    assert calls == traced


def test_only_what_is_asked_for_is_kept():
    some = sp.filter(MODEL, Y, None, sp.ukf(), keep=("mean", "std"))
    assert some.cov is None
    assert some.nis is None
    np.testing.assert_allclose(some.mean, sp.filter(MODEL, Y, None, sp.ukf()).mean, rtol=1e-10)
    assert sp.smooth(MODEL, Y, None, sp.ukf(), keep=("mean",)).std is None


def test_float32_in_float32_out():
    p = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), (P.Q, P.R, P.m0, P.P0))
    model = sp.StateSpaceModel(P.f, P.h, p[0], p[1], sp.Gaussian(p[2], p[3]))
    post = sp.filter(model, Y, None, sp.srcdkf())
    assert {a.dtype for a in jax.tree.leaves(post)} == {jnp.dtype("float32")}
    double = sp.filter(MODEL, Y, None, sp.srcdkf())
    assert np.max(np.abs(np.asarray(post.mean) - np.asarray(double.mean)) / np.asarray(double.std)) < 0.02


def test_joint_with_zero_variance_is_the_state_filter():
    """A constant with no variance beside the state changes nothing, forward or backward, dense or square root."""
    wide = sp.StateSpaceModel(
        lambda x, u: jnp.concatenate([P.f(x[1:], u), x[:1]])[jnp.array([5, 0, 1, 2, 3, 4])],
        lambda x, u: P.h(x[1:], u) * x[0],
        np.pad(P.Q, ((1, 0), (1, 0))),
        P.R,
        sp.Gaussian(np.concatenate([[1.0], P.m0]), np.pad(P.P0, ((1, 0), (1, 0)))),
    )
    for method in (sp.srekf(), sp.cdkf(), sp.srcdkf()):
        a, b = sp.smooth(wide, Y, None, method), sp.smooth(MODEL, Y, None, method)
        assert np.max(np.abs(a.mean[:, 1:] - b.mean) / b.std) < 1e-9
        np.testing.assert_allclose(a.std[:, 1:], b.std, rtol=1e-9)
        np.testing.assert_allclose(a.log_likelihood, b.log_likelihood, rtol=1e-12)
        assert float(np.abs(a.std[:, 0]).max()) == 0
