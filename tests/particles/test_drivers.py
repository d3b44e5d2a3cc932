"""online = filter = a row of a batch; missing rows leave the prediction; weights beyond all numbers."""

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
import pytest
from particles.scalar_case import EXACT, MODEL, Y, makes, some, sums

import sigmapoint as sp
from sigmapoint.particles.weights import weighed

DRAWS = 1e-6
"""Agreement of two programs: draws are computed in 32 bits, and the compiler may round them in another order."""
SOME = ["bootstrap", "upf", "auxiliary upf", "moved upf", "Rao-Blackwellised", "gspf", "gmsppf"]
SLOW = ["upf", "auxiliary", "auxiliary upf", "gspf"]
N = 200


def every(count):
    return makes(count) | sums(count)


def beliefs(state):
    return state.mean, state.std, state.particles, state.log_weights


@pytest.mark.parametrize("name", some(SOME, SLOW))
def test_online_is_filter(name):
    method = every(N)[name]
    kept = [field for field in ("mean", "particles", "ancestors", "log_weights") if field in method.posterior.FIELDS]
    whole = sp.filter(MODEL, Y, method=method, key=3, keep=tuple(kept))
    live = sp.online(MODEL, method)
    state = live.init(key=3)
    for k in range(4):
        state, info = live.update(state, Y[k])
        for field in kept:
            np.testing.assert_allclose(getattr(state, field), getattr(whole, field)[k], rtol=DRAWS, atol=DRAWS)
        np.testing.assert_allclose(info.ess, whole.ess[k], rtol=DRAWS)
        state = live.predict(state)


@pytest.mark.parametrize("name", some(SOME, SLOW))
def test_a_missing_row_leaves_the_prediction(name):
    live = sp.online(MODEL, every(N)[name])
    state = live.predict(live.update(live.init(key=0), [1.0])[0])
    after, info = live.update(state, [jnp.nan])
    for one, two in zip(beliefs(after), beliefs(state), strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-12)
    assert float(info.log_likelihood) == pytest.approx(0, abs=1e-12)
    assert float(info.ess) > 0
    assert float(info.nis) == 0
    assert np.isnan(info.innovation).all()


@pytest.mark.parametrize("name", some(["bootstrap", "upf", "auxiliary"], SLOW))
def test_two_measurements_at_one_instant_both_count(name):
    live, exact = sp.online(MODEL, makes(20_000)[name]), sp.online(MODEL)
    state, truth = live.init(key=0), exact.init()
    for _ in range(2):
        for y in ([1.0], [0.4]):
            (state, _), (truth, _) = live.update(state, y), exact.update(truth, y)
        np.testing.assert_allclose(state.mean, truth.mean, atol=0.03)
        np.testing.assert_allclose(state.std, truth.std, rtol=0.05)
        state, truth = live.predict(live.predict(state)), exact.predict(exact.predict(truth))


@pytest.mark.parametrize("smoother", some([sp.backward_simulation(20), None, sp.fixed_lag(2)], [None, sp.fixed_lag(2)]))
def test_a_row_of_a_batch_is_a_single_run(smoother):
    series = [np.asarray(Y[:3]), np.asarray(Y)]
    many = sp.batch(MODEL, series, method=sp.ekpf(N), key=5, smoother=smoother)
    for one, y, key in zip(many, series, jax.random.split(jax.random.key(5), 2)):
        how = {"method": sp.ekpf(N), "key": key}
        alone = sp.filter(MODEL, y, **how) if smoother is None else sp.smooth(MODEL, y, smoother=smoother, **how)
        np.testing.assert_allclose(one.mean, alone.mean, rtol=DRAWS, atol=DRAWS)
        np.testing.assert_allclose(one.ess, alone.ess, rtol=DRAWS)


def test_saved_loaded_and_continued_is_uninterrupted(tmp_path):
    live = sp.online(MODEL, sp.upf(50))
    state = live.predict(live.update(live.init(key=1), [1.0])[0])
    sp.save(tmp_path / "state.npz", state)
    resumed = sp.load(tmp_path / "state.npz", like=live.init(key=2))
    np.testing.assert_array_equal(live.predict(resumed).particles, live.predict(state).particles)


def test_weights_beyond_the_smallest_number_survive():
    post = sp.filter(MODEL, jnp.array([[1.0], [1e4], [0.5]]), method=sp.bootstrap(500), key=0)
    assert float(post.log_likelihood) < -5000 * np.log(10)
    assert np.isfinite(post.log_likelihood)
    assert all(np.isfinite(getattr(post, name)).all() for name in ("mean", "cov", "std", "nis"))
    assert post.ess[1] >= 1


def test_where_no_particle_explains_a_measurement_they_stay_as_predicted():
    y = jnp.array([[1.0], [1e200], [0.5]])
    with pytest.warns(UserWarning, match="no particle explains the measurement of row 1"):
        post = sp.filter(MODEL, y, method=sp.bootstrap(500), key=0, keep=("mean", "std", "log_weights"))
    missing = sp.filter(MODEL, y.at[1].set(jnp.nan), method=sp.bootstrap(500), key=0, keep=("mean",))
    assert float(post.log_likelihood) == -np.inf
    assert float(post.ess[1]) == 0
    np.testing.assert_allclose(post.mean, missing.mean, rtol=1e-12)
    assert np.isfinite(post.log_weights).all()


@pytest.mark.parametrize(
    "name", some(["upf", "auxiliary", "Rao-Blackwellised", "gspf", "gmsppf"], ["auxiliary", "gspf"])
)
def test_proposals_leave_what_they_cannot_explain(name):
    """No density at all that far out, for particles that a proposal has drawn near."""
    live = sp.online(MODEL, every(100)[name])
    state = live.predict(live.update(live.init(key=0), [1.0])[0])
    after, info = live.update(state, [1e200])
    assert (float(info.log_likelihood), float(info.ess)) == (-np.inf, 0)
    for one, two in zip(beliefs(after), beliefs(state), strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-12)


def test_simulate_with_the_same_key_draws_other_numbers():
    """Or else the true state would be among the particles."""
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        model = sp.StateSpaceModel(
            lambda x, u: x, lambda x, u: x, jnp.eye(1), jnp.eye(1), dist.Normal(jnp.zeros(1), 10)
        )
        x, _ = sp.simulate(model, 2, key=0)
        for method in (sp.bootstrap(50), sp.gspf(50, 5)):
            assert np.abs(np.asarray(sp.online(model, method).init(key=0).particles - x[0])).min() > 1e-9


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_weights_sum_to_one_whatever_their_size(dtype):
    x = jnp.linspace(-2, 2, 200, dtype=dtype)
    for off in (1e2, 1e5, 1e7, 1e15):
        found = weighed(jnp.zeros_like(x), -(x**2) / 2 - jnp.asarray(off, dtype))
        np.testing.assert_allclose(jnp.exp(found.log_weights).sum(), 1, rtol=1e-5)


def test_particles_for_which_the_model_has_no_value_weigh_nothing():
    model = sp.StateSpaceModel(
        lambda x, u: x, lambda x, u: jnp.sqrt(x), 0.1 * jnp.eye(1), 0.1 * jnp.eye(1), MODEL.initial
    )
    post = sp.filter(model, jnp.ones((3, 1)), method=sp.bootstrap(2000), key=0, keep=("mean", "std"))
    assert np.isfinite(post.mean).all()
    assert abs(float(post.mean[-1, 0]) - 1) < 0.3


def test_float32_in_float32_out():
    small = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), (MODEL.initial.mean, MODEL.initial.cov))
    model = sp.StateSpaceModel(
        lambda x, u: jnp.float32(0.9) * x,
        lambda x, u: x,
        0.5 * jnp.eye(1, dtype=jnp.float32),
        0.25 * jnp.eye(1, dtype=jnp.float32),
        sp.Gaussian(*small),
    )
    for method in (sp.bootstrap(20_000), sp.upf(5000)):
        post = sp.filter(model, np.asarray(Y), method=method, key=0)
        assert {a.dtype for a in jax.tree.leaves(post)} == {jnp.dtype("float32")}
        assert np.abs(np.asarray(post.mean) - np.asarray(EXACT.mean)).max() < 0.05


def test_an_angle_is_averaged_the_short_way_round():
    model = sp.StateSpaceModel(
        lambda x, u: x,
        lambda x, u: x,
        0.01 * jnp.eye(1),
        0.01 * jnp.eye(1),
        sp.Gaussian(jnp.array([3.1]), 0.04 * jnp.eye(1)),
        state_space=sp.angles(0),
        observation_space=sp.angles(0),
    )
    y = np.array([[3.12], [-3.13], [-3.05], [-3.0]])
    exact = sp.filter(model, y)
    for method in (sp.bootstrap(20_000), sp.ekpf(5000)):
        post = sp.filter(model, y, method=method, key=0)
        off = jax.vmap(model.state_space.residual)(post.mean, exact.mean)
        assert float(jnp.abs(off).max()) < 0.01
        np.testing.assert_allclose(post.std, exact.std, rtol=0.05)


def test_second_call_compiles_nothing():
    traced = []

    def f(x, u):
        traced.append(1)
        return 0.5 * x

    model = sp.StateSpaceModel(f, lambda x, u: x, jnp.eye(1), jnp.eye(1), MODEL.initial)
    sp.filter(model, np.ones((5, 1)), method=sp.bootstrap(10), key=0)
    before = len(traced)
    sp.filter(model, np.zeros((5, 1)), method=sp.bootstrap(10), key=1)
    assert before == len(traced) > 0


def test_only_what_is_asked_for_is_kept():
    post = sp.filter(MODEL, Y, method=sp.bootstrap(10), key=0)
    assert post.particles is None
    assert post.log_weights is None
    some = sp.filter(MODEL, Y, method=sp.bootstrap(10), key=0, keep=("particles", "log_weights", "ancestors"))
    assert some.mean is None
    assert some.particles.shape == (6, 10, 1)
    np.testing.assert_allclose(np.exp(some.log_weights).sum(1), 1, rtol=1e-12)
    assert isinstance(some, sp.ParticlePosterior)


def test_compare_diagnose_and_report_take_particle_filters(tmp_path):
    x, y = sp.simulate(MODEL, 40, key=0)
    table = sp.compare(MODEL, y, truth=x, methods={"srcdkf": sp.srcdkf(), "bootstrap": sp.bootstrap(2000)}, key=0)
    rmse = [row["rmse x0"] for row in table.rows]
    assert rmse[1] == pytest.approx(rmse[0], rel=0.05)
    assert 200 < table.rows[1]["ess"] < 2000
    assert " ess " in str(table).splitlines()[0]
    smoothed = sp.compare(
        MODEL, y, truth=x, methods={"ukf": sp.ukf(), "bootstrap": sp.bootstrap(2000)}, key=0, smooth=True
    )
    assert smoothed.rows[1]["rmse x0"] == pytest.approx(smoothed.rows[0]["rmse x0"], rel=0.1)
    assert smoothed.rows[0]["rmse x0"] < rmse[0]
    assert sp.diagnose(table.posteriors["bootstrap"]).verdicts
    sp.report(table.posteriors, tmp_path / "page.html", truth=x)
    assert "ess" in table.posteriors["bootstrap"].to_frame()


def test_particles_in_a_dataset_have_axes_of_their_own():
    post = sp.filter(MODEL, Y, method=sp.bootstrap(10), key=0, keep=("mean", "particles", "log_weights"))
    data = post.to_xarray()
    assert dict(data["particles"].sizes) == {"time": 6, "particle": 10, "state": 1}
    assert data["ess"].dims == ("time",)
    assert "ancestors" not in data
    assert "ess" not in sp.filter(MODEL, Y).to_xarray()


def test_a_diagnosis_says_that_few_particles_count():
    """A carried covariance far wider than the process noise: what the unscented particle filter is not for."""
    F = jnp.array([[1.0, 1.0], [0.0, 1.0]])
    Q = jnp.diag(jnp.array([1e-3, 1e-2]))
    still = sp.StateSpaceModel(
        lambda x, u: F @ x, lambda x, u: x[:1], Q, 0.2 * jnp.eye(1), sp.Gaussian(jnp.zeros(2), jnp.eye(2))
    )
    y = sp.simulate(still, 40, key=1)[1]
    said = sp.diagnose(sp.filter(still, y, method=sp.upf(100), key=0))
    assert "effective sample size" in str(said).splitlines()[0]
    guided = sp.auxiliary(sp.particle_filter(100, proposal=sp.proposals.guided(sp.ekf())))
    assert sp.diagnose(sp.filter(still, y, method=guided, key=0)).few == 0


def test_noise_inside_the_dynamics_is_drawn():
    walk = sp.StateSpaceModel(
        lambda x, u, w: x * jnp.exp(w),
        lambda x, u: x,
        sp.NonAdditive(0.01 * jnp.eye(1)),
        0.1 * jnp.eye(1),
        MODEL.initial,
    )
    post = sp.filter(walk, jnp.ones((10, 1)), method=sp.bootstrap(2000), key=0)
    assert abs(float(post.mean[-1, 0]) - 1) < 0.1
