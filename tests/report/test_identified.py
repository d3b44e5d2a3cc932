"""Pages and axes of identified models: parameters in their own units, noises, and how the search for them went."""

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import pytest
from report.test_page import graphs, own, values

import sigmapoint as sp
from sigmapoint.identification.profile import Profile
from sigmapoint.reporting import report

mpl.use("Agg")
T = 60
THETA = {"a": sp.bounded(0.5, 0.2, low=0.0, high=1.0), "<b>": sp.positive(0.5, 0.2), "note": "no number"}


def build(theta):
    return sp.StateSpaceModel(
        lambda x, u: theta["a"] * x,
        lambda x, u: x,
        0.1 * jnp.eye(1),
        theta["<b>"] * jnp.eye(1),
        sp.Gaussian(jnp.zeros(1), jnp.eye(1)),
        state_names=("level",),
        state_units=("m",),
    )


@pytest.fixture(scope="module")
def y():
    return sp.simulate(build({"a": 0.9, "<b>": 0.3}), T, key=jax.random.key(0))[1]


@pytest.fixture(scope="module")
def dual(y):
    return sp.dual(build, THETA, cost=sp.maximum_likelihood(), state_method=sp.ekf()).filter(y, epochs=2)


@pytest.fixture(scope="module")
def fit(y):
    return sp.fit(build, THETA, y, method=sp.ekf())


@pytest.fixture(scope="module")
def em(y):
    return sp.em(build({"a": 0.9, "<b>": 0.5}), y, initial=None, tolerance=1e-2, method=sp.ekf())


def drawn(html):
    """The figures of a page by what their vertical axis says."""
    return {figure["layout"]["yaxis"]["title"]["text"]: figure for figure in graphs(html)}


def curve(figure):
    return np.array(values(figure["data"][-1]["y"]), float)


def test_a_page_of_dual_has_the_parameters_over_time_and_the_epochs(dual, tmp_path):
    html = report(dual, tmp_path / "r.html", time=np.arange(T) / 10, time_label="time [s]").read_text()
    figures = drawn(html)
    assert "level [m]" in figures
    for name in ("a", "<b>"):
        np.testing.assert_allclose(curve(figures[name]), dual.estimates.value[name], rtol=1e-6)
        assert figures[name]["layout"]["xaxis"]["title"]["text"] == "time [s]"
        outline = np.array(values(figures[name]["data"][0]["y"]))
        np.testing.assert_allclose(outline[:T], dual.estimates.low[name], rtol=1e-5)
        np.testing.assert_allclose(outline[T:][::-1], dual.estimates.high[name], rtol=1e-5)
    np.testing.assert_allclose(curve(figures["Log-likelihood"]), dual.history.log_likelihood)
    assert f'<td>a</td><td class="number">{float(dual.theta["a"]):.5g}</td>' in html
    assert "<b>&" not in html
    assert "no number" not in html


def test_one_epoch_has_no_curve_over_epochs(y, tmp_path):
    once = sp.dual(build, THETA, cost=sp.maximum_likelihood(), state_method=sp.ekf()).filter(y)
    assert 'id="epochs"' not in report(once, tmp_path / "r.html").read_text()


def test_several_results_are_drawn_together_under_their_names(dual, fit, tmp_path):
    html = report({"first": dual, "second": dual, "fit": fit}, tmp_path / "r.html").read_text()
    names = [trace["name"] for trace in drawn(html)["a"]["data"]]
    assert names == ["first 95 % band", "first", "second 95 % band", "second"]
    assert html.count('id="parameters"') == html.count('href="#parameters"') == 1
    assert "<td>fit</td><td>a</td>" in html
    assert "fit: Log-likelihood" in html


def test_a_page_of_em_has_the_likelihood_step_by_step_and_the_noises(em, y, tmp_path):
    html = report(em, tmp_path / "r.html").read_text()
    (figure,) = graphs(html)
    np.testing.assert_allclose(curve(figure), em.log_likelihood)
    Q = float(em.model.process_noise.cov[0, 0])
    cells = f'<td>level</td><td>m</td><td class="number">{Q**0.5:.5g}</td><td class="number">{Q:.5g}</td>'
    assert cells in html
    assert "correlation with" not in html  # of one element
    both = own(report({"em": em, "filter": sp.filter(em.model, y)}, tmp_path / "r.html").read_text())
    assert both.index('id="trust"') < both.index('id="expectation-maximisation"') < both.index('id="states"')


def test_correlations_are_listed_where_there_are_any(em, tmp_path):
    Q = np.array([[1.0, 0.5], [0.5, 4.0]])
    two = sp.StateSpaceModel(lambda x, u: x, lambda x, u: x[:1], Q, np.eye(1), sp.Gaussian(np.zeros(2), np.eye(2)))
    html = report(em._replace(model=two, converged=False), tmp_path / "r.html").read_text()
    row = ("x0", "1", "1", "1", "0.25")
    assert "<td>x0</td>" + "".join(f'<td class="number">{cell}</td>' for cell in row[1:]) in html
    assert html.count("correlation with x1") == 1
    assert "Not converged, and the best model so far is shown" in html


def test_noises_that_change_or_are_not_additive_do_not_hinder(em, tmp_path):
    changing = sp.StateSpaceModel(
        lambda x, u, w: x + w[:1], lambda x, u: x, sp.NonAdditive(np.eye(2)), np.ones((9, 1, 1)), em.model.initial
    )
    html = report(em._replace(model=changing, theta={"k": jnp.ones(2)}), tmp_path / "r.html").read_text()
    assert "<caption>Observation noise" not in html
    assert "<td>w1</td>" in html
    assert "<td>k[1]</td>" in html


def test_a_page_of_fit_has_the_table_and_the_profiles_that_are_given(fit, tmp_path):
    html = report(fit, tmp_path / "r.html").read_text()
    assert not graphs(html)
    cells = (fit.theta["a"], fit.estimates.std["a"], fit.estimates.low["a"], fit.estimates.high["a"])
    assert "<td>a</td>" + "".join(f'<td class="number">{float(c):.5g}</td>' for c in cells) in html
    profile = Profile("a", np.linspace(0.8, 1.0, 5), np.array([-5.0, -1, 0, -1, -6]), 0.0)
    both = report({"fit": fit, "a": profile}, tmp_path / "r.html").read_text()
    (figure,) = graphs(both)
    assert figure["layout"]["shapes"][0]["y0"] == -2.0
    assert figure["layout"]["xaxis"]["title"]["text"] == "a"


def test_what_measurements_leave_open_is_said(fit, tmp_path):
    lost = eqx.tree_at(lambda f: (f.z_cov, f.converged), fit, (fit.z_cov.at[0].set(jnp.nan), False))
    html = report(lost, tmp_path / "r.html").read_text()
    assert f"The measurements leave {fit.names[0]} open".replace("<", "&lt;").replace(">", "&gt;") in html
    assert "not to be used" in html


def test_parameters_of_a_joint_model_are_in_their_own_units_in_place_of_z(y, tmp_path):
    model = sp.joint(build, THETA)
    post = sp.filter(model, y, method=sp.ekf())
    figures = drawn(report(post, tmp_path / "r.html", theta=THETA, truth=np.zeros((T, 1))).read_text())
    assert {"a", "<b>", "level [m]", "error of level [m]"} <= set(figures)
    assert not any("z." in what for what in figures)
    np.testing.assert_allclose(curve(figures["a"]), sp.estimates(THETA, post).value["a"], rtol=1e-6)
    np.testing.assert_allclose(curve(figures["error of level [m]"]), -post.mean[:, 0], rtol=1e-5)
    both = {"one": post, "two": post}
    assert len(drawn(report(both, tmp_path / "r.html", theta=THETA).read_text())["a"]["data"]) == 4
    assert "z.a" in drawn(report(post, tmp_path / "r.html").read_text())


def test_angles_and_their_sizes_stay_beside_parameters(unit_vector, tmp_path):
    """The states in front of z are on their own space again, and the covariance has its directions."""
    model, y = unit_vector(50)
    theta = {"rate": sp.real(0.1, 0.01)}
    joint = sp.joint(lambda t: _turned(model, t["rate"]), theta)
    html = report(sp.filter(joint, y), tmp_path / "r.html", theta=theta, truth=np.zeros((50, 1))).read_text()
    assert {"rate", "heading"} <= set(drawn(html))


def _turned(model, rate):
    return sp.StateSpaceModel(
        lambda x, u: x + rate,
        model.observation,
        model.process_noise,
        model.observation_noise,
        model.initial,
        state_space=model.state_space,
        observation_space=model.observation_space,
        state_names=model.state_names,
    )


def test_what_does_not_belong_to_a_result_is_refused_by_name(dual, em, fit, y, tmp_path):
    path = tmp_path / "r.html"
    for result, given, said in (
        (em, {"time": np.arange(T)}, "time and truth are for results over a series"),
        (fit, {"truth": y}, "time and truth are for results over a series"),
        (fit, {"theta": THETA}, r"theta is for results of a model of sp\.joint"),
        (dual, {"theta": THETA}, r"2 parameters in a result of 1 states: is it of sp\.joint"),
        ({"a": fit, "b": 3}, {}, r"sp\.em or the filter of a sp\.dual, .* got int as 'b'"),
        (fit.estimates, {}, "got Estimates"),
        (sp.Comparison([], {}), {}, "nothing to show"),
    ):
        with pytest.raises(ValueError, match=said):
            report(result, path, **given)
    assert not path.exists()


def test_axes_show_each_parameter_with_its_band_and_the_likelihood(dual, em):
    axes = dual.plot(time=np.arange(T) / 10)
    assert [ax.get_ylabel() for ax in axes] == ["<b>", "a"]
    assert axes[-1].get_xlabel() == "time"
    np.testing.assert_array_equal(axes[1].lines[0].get_ydata(), dual.estimates.value["a"])
    (band,) = axes[1].collections
    assert band.get_datalim(axes[1].transData).y1 == float(dual.estimates.high["a"].max())
    assert [t.get_text() for t in axes[0].figure.legends[0].get_texts()] == ["95 % band", "estimate"]
    (ax,) = em.plot()
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), em.log_likelihood)
    assert ax.get_xlabel() == "step"
    mpl.pyplot.close("all")
    with pytest.raises(ValueError, match="time must be one value for each of the 60 rows"):
        dual.plot(time=[1.0])
