"""States and parameters at once."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from turning import as_angle, measured, on_circle, vector

import sigmapoint as sp
from sigmapoint import curves


def _swing(k, dtype=float) -> sp.StateSpaceModel:
    def of(a):
        return jnp.asarray(a, dtype)

    return sp.StateSpaceModel(
        lambda x, u: jnp.stack([x[0] + 0.1 * x[1], x[1] - 0.1 * k * jnp.sin(x[0])]),
        lambda x, u: jnp.sin(x[:1]),
        of(1e-3 * jnp.eye(2)),
        of(1e-2 * jnp.eye(1)),
        sp.Gaussian(of([0.8, 0.0]), of(0.02 * jnp.eye(2))),
    )


ALONE_AND_JOINT = {
    # Points as far out in three dimensions as in two, where that depends on the dimension.
    "ekf": (sp.ekf(),) * 2,
    "srekf": (sp.srekf(),) * 2,
    "cdkf": (sp.cdkf(),) * 2,
    "srcdkf": (sp.srcdkf(),) * 2,
    "ghkf": (sp.ghkf(),) * 2,
    "ukf": (sp.ukf(kappa=1.0, beta=0.0), sp.ukf(kappa=0.0, beta=0.0)),
    "srukf": (sp.srukf(kappa=1.0, beta=0.0), sp.srukf(kappa=0.0, beta=0.0)),
    "iterated": (sp.iterated(sp.srcdkf(), 3),) * 2,
}


SOME = ("srcdkf", "ukf", "iterated")
"""Of both beliefs."""


@pytest.mark.parametrize(
    "name", [name if name in SOME else pytest.param(name, marks=pytest.mark.slow) for name in ALONE_AND_JOINT]
)
def test_parameters_that_are_known_change_nothing(name):
    alone, together = ALONE_AND_JOINT[name]
    swing = _swing(2.0)
    y = sp.simulate(swing, 60, key=1)[1].at[10:13].set(jnp.nan)
    model = sp.joint(lambda k: _swing(k[0]), sp.Gaussian(jnp.array([2.0]), jnp.zeros((1, 1))))
    for run in (sp.filter, sp.smooth):
        one, other = run(swing, y, method=alone), run(model, y, method=together)
        np.testing.assert_allclose(other.mean[:, :2], one.mean, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(other.cov[:, :2, :2], one.cov, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(other.log_likelihood, one.log_likelihood, rtol=1e-12)


@pytest.mark.parametrize("method", [sp.ekf(), sp.srcdkf(), sp.srukf(), sp.augmented(sp.ukf())])
def test_error_bars_of_parameters_are_honest(method):
    """Over 40 series, their normalised squared error is 1 on average: 1 ± 3 √(2/40)."""
    theta = {"k": sp.positive(2.0, 0.3)}
    model = sp.joint(lambda t: _swing(t["k"]), theta)

    def score(key):
        for_k, for_y = jax.random.split(key)
        z = jax.random.normal(for_k, ())
        y = sp.simulate(_swing(2.0 * jnp.exp(0.15 * z)), 100, key=for_y)[1]
        post = sp.filter(model, y, method=method)
        return ((post.mean[-1, 2] - z) / post.std[-1, 2]) ** 2

    scores = jax.jit(jax.vmap(score))(jax.random.split(jax.random.key(0), 40))
    assert abs(scores.mean() - 1) < 3 * (2 / 40) ** 0.5


def test_a_gain_that_is_known_exactly_is_kept_and_others_move_with_what_they_act_on():
    """With measurements of the state itself and no process noise, k is found by regression."""
    true = 0.7
    build = lambda a: sp.StateSpaceModel(  # noqa: E731
        lambda x, u: a * x + u, lambda x, u: x, 1e-12 * jnp.eye(1), 1e-6 * jnp.eye(1),
        sp.Gaussian(jnp.zeros(1), jnp.eye(1)),
    )  # fmt: skip
    u = jax.random.normal(jax.random.key(0), (200, 1))
    _, y = sp.simulate(build(true), 200, key=1, u=u)
    theta = sp.real(0.3, 0.5)
    found = sp.estimates(theta, sp.filter(sp.joint(build, theta), y, u))
    np.testing.assert_allclose(found.value[-1], true, atol=5 * found.std[-1])
    assert found.std[-1] < 1e-3
    assert found.value.shape == (200,)


@pytest.mark.parametrize("method", [sp.srcdkf(), sp.ekf(), sp.ukf()])
def test_badly_scaled_parameters_converge(method):
    def build(t):
        return sp.StateSpaceModel(
            lambda x, u: 0.9 * x + t["small"] * 1e9 * u["a"] + t["large"] * 1e-6 * u["b"], lambda x, u: x,
            1e-4 * jnp.eye(1), 1e-4 * jnp.eye(1), sp.Gaussian(jnp.zeros(1), jnp.eye(1)),
        )  # fmt: skip

    u = {name: jax.random.normal(jax.random.key(i), (300, 1)) for i, name in enumerate("ab")}
    true = {"small": jnp.array(1.5e-9), "large": jnp.array(0.7e6)}
    y = sp.simulate(build(true), 300, key=3, u=u)[1]
    theta = {"small": sp.positive(1e-9, 1e-9), "large": 1e6}
    found = sp.estimates(theta, sp.filter(sp.joint(build, theta), y, u, method))
    for name, value in true.items():
        assert abs(found.value[name][-1] - value) < 4 * found.std[name][-1]
        assert found.std[name][-1] < 0.01 * value
    own = sp.Gaussian(jnp.array([1e-9, 1e6]), jnp.diag(jnp.array([1e-18, 1e12])))
    raw = sp.filter(sp.joint(lambda t: build({"small": t[0], "large": t[1]}), own), y, u, method)
    for i, value in enumerate(true.values()):
        assert abs(raw.mean[-1, 1 + i] - value) < 4 * raw.std[-1, 1 + i]


def test_parameters_that_drift_are_followed():
    a = 0.5 + 0.4 * jnp.sin(jnp.arange(400) / 60)
    build = lambda t: sp.StateSpaceModel(  # noqa: E731
        lambda x, u: t * u, lambda x, u: x, 1e-6 * jnp.eye(1), 1e-4 * jnp.eye(1), sp.Gaussian(jnp.zeros(1), jnp.eye(1))
    )
    u = jax.random.normal(jax.random.key(0), (400, 1))
    y = jnp.concatenate([jnp.zeros((1, 1)), a[:-1, None] * u[:-1]])
    theta, method = sp.real(0.5, 1.0), sp.srcdkf()
    errors = {}
    for name, drift in {"no": 0.0, "number": 4e-4, "fixed": sp.fixed(4e-4), "matrix": 4e-4 * jnp.eye(1)}.items():
        found = sp.estimates(theta, sp.filter(sp.joint(build, theta, drift), y, u, method))
        errors[name] = float(jnp.sqrt(jnp.mean((found.value[50:] - a[49:-1]) ** 2)))
    assert errors["number"] == errors["fixed"] == errors["matrix"] < 0.05 < errors["no"]
    annealed = sp.joint(build, theta, sp.annealed(1e-2, 0.9, floor=4e-4)).process_noise.cov
    np.testing.assert_allclose(annealed[:3, 1, 1], [1e-2, 9e-3, 8.1e-3])
    np.testing.assert_allclose(annealed[-1, 1, 1], 4e-4)


def test_what_depends_on_parameters_besides_the_functions_takes_part():
    """The initial state, and noises: a noise twice as large is what the innovations are measured by."""

    def build(t):
        return sp.StateSpaceModel(
            lambda x, u: x, lambda x, u: x, 1e-8 * jnp.eye(1), jnp.exp(t[1]) * jnp.eye(1),
            sp.Gaussian(2 * t[:1], 1e-8 * jnp.eye(1)),
        )  # fmt: skip

    theta = sp.Gaussian(jnp.zeros(2), jnp.diag(jnp.array([1.0, 0.01])))
    model = sp.joint(build, theta)
    np.testing.assert_allclose(model.initial.cov[:2, :2], [[4 + 1e-8, 2], [2, 1]])
    post = sp.filter(model, jnp.full((1, 1), 3.0), method=sp.ghkf(5))
    np.testing.assert_allclose(post.innovation_cov[0, 0, 0], 4 + jnp.exp(0.005), rtol=1e-6)
    np.testing.assert_allclose(post.mean[0, 1], 3 * 2 / 5, rtol=1e-2)


def test_angles_stay_angles_and_every_driver_works():
    def build(t):
        return sp.StateSpaceModel(
            lambda x, u: jnp.stack([x[0] + t["rate"]]), lambda x, u: x, 1e-4 * jnp.eye(1), 1e-2 * jnp.eye(1),
            sp.Gaussian(jnp.array([3.0]), 0.01 * jnp.eye(1)), state_space=sp.angles(0), observation_space=sp.angles(0),
            state_names=("heading",), state_units=("rad",),
        )  # fmt: skip

    theta = {"rate": sp.real(0.0, 0.3)}
    model = sp.joint(build, theta)
    y = sp.simulate(build({"rate": 0.2}), 80, key=0)[1]
    assert model.state_names == ("heading", "z.rate")
    assert curves.wraps(model.state_space, np.array([[3.1, 0.2], [-3.1, 0.2], [-2.9, 0.2]]), 0).tolist() == [1]
    assert sp.filter(model, y).labels.directions(2).units == ("rad", "")
    smoothed = sp.estimates(theta, sp.smooth(model, y, smoother=sp.two_filter()))
    assert abs(smoothed.value["rate"][0] - 0.2) < 4 * smoothed.std["rate"][0]
    many = sp.batch(model, jnp.stack([y, y]))
    np.testing.assert_allclose(sp.estimates(theta, many).value["rate"][0, -1], smoothed.value["rate"][-1], rtol=1e-9)
    live = sp.online(model)
    state, _ = live.update(live.init(), y[0])
    assert sp.estimates(theta, state).value["rate"] == state.mean[1] * 0.3


@pytest.mark.parametrize("run", [sp.filter, sp.smooth])
def test_points_of_more_numbers_than_directions_are_filtered_as_the_angle(run):
    y, theta = measured(60), sp.real(0.2, 0.1)
    circle, angle = (
        run(sp.joint(build, theta, drift=1e-6), y, method=sp.srcdkf())
        for build, y in ((on_circle, vector(y)), (as_angle, y))
    )
    np.testing.assert_allclose(circle.mean, jnp.hstack([vector(angle.mean[:, :1]), angle.mean[:, 1:]]), atol=1e-9)
    np.testing.assert_allclose(circle.cov, angle.cov, rtol=1e-8, atol=1e-12)
    for one, other in zip(*(jax.tree.leaves(sp.estimates(theta, post)) for post in (circle, angle))):
        np.testing.assert_allclose(one, other, rtol=1e-8)


def test_in_32_bits():
    theta = sp.Gaussian(jnp.array([1.5], jnp.float32), jnp.eye(1, dtype=jnp.float32))
    y = sp.simulate(_swing(2.0), 200, key=1)[1].astype(jnp.float32)
    model = sp.joint(lambda k: _swing(k[0].astype(jnp.float32), jnp.float32), theta)
    post = sp.filter(model, y)
    assert post.mean.dtype == jnp.float32
    assert abs(post.mean[-1, 2] - 2) < 4 * post.std[-1, 2]


def test_unknowns_stay_where_they_may_be():
    z = jnp.linspace(-30, 30, 7)
    for unknown, low, high in (
        (sp.positive(2.0, 0.5), 0, jnp.inf),
        (sp.bounded(0.3, 0.1, 0.0, 1.0), 0, 1),
        (sp.bounded(-7.0, 1.0, -8.0, 5.0), -8, 5),
    ):
        value = unknown.range.value(unknown.center, unknown.std, z)
        assert ((value >= low) & (value <= high)).all()
        assert (jnp.diff(value) >= 0).all()


def test_what_is_no_parameter_is_said():
    with pytest.raises(ValueError, match="value must be between 0 and inf"):
        sp.positive(-1.0, 1.0)
    with pytest.raises(ValueError, match="value must be between 0 and 1"):
        sp.bounded(1.0, 0.1, 0.0, 1.0)
    for low, high in ((1.0, 0.0), (0.0, jnp.inf), (1.0, 1.0)):
        with pytest.raises(ValueError, match="low and high must be finite, low below high"):
            sp.bounded(0.5, 0.1, low, high)
    with pytest.raises(ValueError, match="std must be greater than zero"):
        sp.real(1.0, 0.0)
    with pytest.raises(ValueError, match="does not fit a value"):
        sp.real(jnp.ones(2), jnp.ones(3))
    with pytest.raises(ValueError, match="theta has no unknown parameters"):
        sp.joint(_swing, {"k": "two"})
    with pytest.raises(ValueError, match="other drifts are for"):
        sp.joint(_swing, 1.0, sp.forgetting(0.99))
    with pytest.raises(ValueError, match="needs a floor"):
        sp.joint(_swing, 1.0, sp.annealed(1e-3, 0.99))
    with pytest.raises(ValueError, match="too many"):
        sp.joint(lambda t: _swing(t[0]), sp.real(jnp.ones(50), 1.0), sp.annealed(1.0, 0.9999, 1e-9))
    with pytest.raises(ValueError, match="drift must be a variance"):
        sp.joint(_swing, 1.0, jnp.ones(3))
    post = sp.filter(_swing(1.0), jnp.ones((3, 1)), keep=("mean",))
    with pytest.raises(ValueError, match="estimates: the result has no mean or no std"):
        sp.estimates(1.0, post)


def test_what_is_no_parameter_goes_along_and_states_keep_their_precision():
    theta = {"k": sp.real(jnp.asarray(1.5, jnp.float32), 0.5), "shape": jnp.sin, "on": True}

    def build(t):
        assert t["on"] is True
        return sp.StateSpaceModel(
            lambda x, u: x + 0.1 * t["shape"](x) * t["k"].astype(float), lambda x, u: x, 1e-3 * jnp.eye(1),
            1e-2 * jnp.eye(1), sp.Gaussian(jnp.ones(1), jnp.eye(1)),
        )  # fmt: skip

    model = sp.joint(build, theta)
    post = sp.filter(model, jnp.ones((5, 1)))
    found = sp.estimates(theta, post)
    assert found.value["shape"] is jnp.sin
    assert found.value["k"].shape == (5,)
    x = jnp.array([0.56172839, 0.0])
    assert model.dynamics(x, None)[0] == build({**theta, "k": jnp.asarray(1.5)}).dynamics(x[:1], None)[0]


def test_a_drift_stays_at_its_floor_however_long_the_series():
    def still(z):
        return sp.StateSpaceModel(
            lambda x, u: 0.5 * x, lambda x, u: jnp.zeros(1) * z, jnp.eye(1), jnp.eye(1),
            sp.Gaussian(jnp.zeros(1), jnp.eye(1)),
        )  # fmt: skip

    model = sp.joint(still, sp.real(0.0, 1.0), sp.annealed(1.0, 0.5, 0.25))
    variance = sp.filter(model, np.full((8, 1), np.nan)).cov[:, 1, 1]
    np.testing.assert_allclose(np.diff(variance), [1.0, 0.5, *[0.25] * 5], rtol=1e-9)


@pytest.mark.parametrize("given", [0.01, 0.03, 0.3, 3.0])
def test_a_deviation_is_half_the_central_68_percent(given):
    z = jnp.array([-1.0, 0.0, 1.0])
    for unknown in (sp.real(0.03, given), sp.positive(0.03, given), sp.bounded(0.03, given, -1.0, 7.0)):
        low, middle, high = (float(unknown.range.value(unknown.center, unknown.std, one)) for one in z)
        np.testing.assert_allclose([middle, (high - low) / 2], [0.03, given], rtol=1e-9)


def test_estimates_are_of_the_parameters_that_were_joined():
    theta = {"k": sp.real(2.0, 0.1)}
    post = sp.filter(sp.joint(lambda t: _swing(t["k"]), theta), jnp.zeros((3, 1)))
    with pytest.raises(ValueError, match=r"theta must be the one that was given to joint: it makes z\.other"):
        sp.estimates({"other": theta["k"]}, post)
    with pytest.raises(ValueError, match="a function that JAX can trace"):
        sp.joint(lambda t: _swing(float(t["k"])), theta)
    with pytest.raises(ValueError, match=r"std must be less than 0\.5"):
        sp.bounded(0.5, 0.5, low=0.0, high=1.0)
