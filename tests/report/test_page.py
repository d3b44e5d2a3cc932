"""The page is whole: every figure parses, nothing is fetched, nothing of the user's text becomes markup."""

import base64
import json
import re
import time as clock

import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import pytest
from plotly.offline import get_plotlyjs

import sigmapoint as sp
from sigmapoint.plotting import plot_states
from sigmapoint.reporting import report
from sigmapoint.reporting.decimate import POINTS, compact, extremes, with_breaks

mpl.use("Agg")
T = 300


def model_of(n=2, **names):
    return sp.StateSpaceModel(
        lambda x, u: 0.95 * x,
        lambda x, u: x[:1] + x[1:2],
        0.1 * jnp.eye(n),
        jnp.eye(1),
        sp.Gaussian(jnp.zeros(n), jnp.eye(n)),
        **names,
    )


@pytest.fixture(scope="module")
def run():
    model = model_of(state_names=("<b>level</b>", "rate"), state_units=("m", "1"), observation_names=("</script>",))
    x, y = sp.simulate(model, T, key=jax.random.key(0))
    y = y.at[10:20].set(jnp.nan)
    return {name: sp.filter(model, y, method=method) for name, method in (("ukf", sp.ukf()), ("ekf", sp.ekf()))}, x


def graphs(html):
    found = re.findall(r'<script type="application/json" id="graph\d+-data">(.*?)</script>', html, re.DOTALL)
    return [json.loads(text) for text in found]


def own(html):
    """The page without plotly's own code."""
    return html.replace(get_plotlyjs(), "")


def test_every_figure_has_data_and_a_place(run, tmp_path):
    posts, x = run
    path = report(posts["ukf"], tmp_path / "report.html", truth=x, title="A & B")
    html = path.read_text()
    figures = graphs(html)
    assert len(figures) == html.count('class="graph"') == 2 + 2 + 2 + 1 + 3
    assert all(figure["data"] for figure in figures)
    assert html.count(get_plotlyjs()) == 1
    assert "<title>A &amp; B</title>" in html


def test_several_methods_are_drawn_together(run, tmp_path):
    posts, x = run
    html = report(posts, tmp_path / "report.html", truth=x).read_text()
    assert {"ukf", "ekf", "truth"} <= {trace.get("name") for trace in graphs(html)[0]["data"]}
    assert html.count("<details") == 2


def test_nothing_is_fetched_and_text_stays_text(run, tmp_path):
    posts, x = run
    tables = [
        ("<i>caption</i>", [{"<u>column</u>": "<img src=http://a.b/c>", "n": 3, "x": np.float64(0.25)}]),
        ("none", []),
    ]
    path = report(posts, tmp_path / "r.html", truth=x, title="<script>1</script>", tables=tables, notes="<a href=x>")
    html = own(path.read_text())
    assert not re.search(r"<(script|img|iframe|link|source)[^>]*\b(src|href)\s*=\s*(?![\"']?data:)", html)
    assert not re.search(r"url\(|@import|https?://(?!a\.b)", html)
    assert not re.search(r"<(b|i|u|img)\b[^>]*>(level|caption|column)|<script>1|<a href=x>", html)
    assert html.count("</script>") == html.count("<script")
    assert 'name="viewport"' in html


def test_verdicts_have_words_and_not_colour_alone(run, tmp_path):
    posts, _ = run
    html = report(posts["ukf"], tmp_path / "report.html").read_text()
    items = re.findall(r'<li class="(good|warning|bad)"><b>([^<]+)</b><span>([^<]+)</span>', html)
    assert items
    assert all(word and text for _, word, text in items)


def test_a_long_series_is_quick_small_and_says_so(tmp_path):
    long = 100_000
    model = model_of()
    _, y = sp.simulate(model, long, key=jax.random.key(1))
    post = sp.filter(model, y)
    stamps = np.datetime64("2024-01-01") + np.arange(long).astype("timedelta64[s]")
    start = clock.perf_counter()
    path = report(post, tmp_path / "report.html", time=stamps)
    assert clock.perf_counter() - start < 20
    assert path.stat().st_size < len(get_plotlyjs()) + 5e6
    assert f"at most {POINTS} points" in path.read_text()


def test_many_states_are_drawn_in_part_and_the_page_says_so(tmp_path):
    post = sp.filter(model_of(15), jnp.ones((20, 1)))
    html = report(post, tmp_path / "report.html").read_text()
    assert "The first 12 of 15 states are drawn." in html


@pytest.mark.parametrize("keep", [("mean", "std"), ("mean",), (), ("nis",)])
def test_a_result_of_which_little_was_kept_still_makes_a_page(keep, tmp_path):
    post = sp.filter(model_of(), jnp.ones((20, 1)), keep=keep)
    html = report(post, tmp_path / "report.html", truth=np.zeros((20, 2))).read_text()
    assert "nothing here checks the filter" in html


@pytest.mark.parametrize("y", [jnp.ones((1, 1)), jnp.full((40, 1), jnp.nan), jnp.zeros((40, 1))])
def test_degenerate_series_make_a_page(y, tmp_path):
    post = sp.filter(model_of(), y)
    assert graphs(report(post, tmp_path / "report.html", truth=np.zeros((len(y), 2))).read_text())


def test_measurements_with_fewer_degrees_of_freedom_than_elements_make_a_page(unit_vector, tmp_path):
    post = sp.filter(*unit_vector(100))
    html = report(post, tmp_path / "report.html").read_text()
    assert len(graphs(html)) == 1 + 3 + 1 + 3  # state; two measurements and an innovation; NIS; tests of the innovation
    assert "e0 innovation" in html


def test_nothing_is_left_behind_when_writing_fails(run, tmp_path, monkeypatch):
    posts, _ = run
    path = report(posts["ukf"], tmp_path / "report.html")
    before = path.read_bytes()

    def full(*_):
        raise OSError("No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space left"):
        report(posts["ekf"], path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]


def test_what_cannot_be_reported_is_refused_by_name(run, tmp_path):
    posts, x = run
    path = tmp_path / "report.html"
    with pytest.raises(ValueError, match="result must come from"):
        report({}, path)
    with pytest.raises(ValueError, match="batch of shape"):
        report(jax.tree.map(lambda a: a[None], posts["ukf"]), path)
    with pytest.raises(ValueError, match="'short' is of another series"):
        report({"ukf": posts["ukf"], "short": sp.filter(model_of(), jnp.ones((5, 1)))}, path)
    with pytest.raises(ValueError, match="time must be one value"):
        report(posts, path, time=[1.0])
    with pytest.raises(ValueError, match="truth must have the shape"):
        report(posts, path, truth=x[:5])
    assert not path.exists()


def test_decimation_keeps_every_peak():
    rng = np.random.default_rng(0)
    curve = rng.normal(size=50_001)
    curve[[123, 40_000]] = 50.0, -50.0
    rows = extremes(curve)
    assert rows.size <= POINTS
    assert (np.diff(rows) > 0).all()
    assert {0, 123, 40_000, 50_000} <= set(rows.tolist())
    assert extremes(curve[:100]).size == 100
    gaps = np.where(np.arange(curve.size) < 30_000, np.nan, curve)
    assert np.nanmin(gaps[extremes(gaps)]) == -50.0


@pytest.fixture(scope="module")
def turning():
    """A heading in degrees that turns once in 90 samples, measured from 0 to 360."""
    heading = sp.angles(0, period=360.0)
    model = sp.StateSpaceModel(
        lambda x, u: x + 4.0,
        lambda x, u: x,
        0.1 * jnp.eye(1),
        jnp.eye(1),
        sp.Gaussian(jnp.zeros(1), jnp.eye(1)),
        state_space=heading,
        observation_space=heading,
    )
    x, y = sp.simulate(model, 20_000, key=jax.random.key(0))
    return model, x % 360, y % 360


def steps(trace):
    """Between neighbours that a line joins; a missing value, null in the page, ends the line."""
    y = np.array([np.nan if v is None else v for v in values(trace["y"])])
    return np.diff(y)[~np.isnan(np.diff(y))]


def values(coded):
    if isinstance(coded, list):
        return coded
    return np.frombuffer(base64.b64decode(coded["bdata"]), coded["dtype"])


@pytest.mark.parametrize("T", [500, 20_000])  # drawn in full, and decimated
def test_no_line_crosses_the_page_where_an_angle_wraps(turning, T, tmp_path):
    model, x, y = turning
    html = report(sp.filter(model, y[:T]), tmp_path / "report.html", truth=x[:T]).read_text()
    traces = [trace for figure in graphs(html) for trace in figure["data"]]
    lines = [trace for trace in traces if trace["name"] in ("estimate", "truth", "predicted")]
    bands = [trace for trace in traces if trace["name"] == "±2σ"]
    measured = next(values(trace["y"]) for trace in traces if trace["name"] == "measured")
    assert len(lines) == 3
    assert max(np.abs(steps(trace)).max() for trace in lines + bands[:1]) < 180
    assert all(np.isnan(np.array(values(trace["y"]), float)).sum() >= T // 95 for trace in lines)
    assert -180 <= np.min(measured) < np.max(measured) <= 180  # as the estimates are


def test_axes_end_a_line_where_an_angle_wraps(turning):
    model, x, y = turning
    (ax,) = sp.filter(model, y[:500]).plot(truth=x[:500])
    for line in ax.lines:
        step = np.diff(line.get_ydata())
        assert np.abs(step[~np.isnan(step)]).max() < 180
        assert np.isnan(line.get_ydata()).sum() == 6  # at 180, 540, … 1980 of 2000 degrees
    mpl.pyplot.close(ax.figure)


def test_predictions_of_a_slow_sensor_are_seen_between_their_gaps(tmp_path):
    _, y = sp.simulate(model_of(), T, key=jax.random.key(2))
    post = sp.filter(model_of(), y.at[np.arange(T) % 3 > 0].set(jnp.nan))
    traces = [trace for figure in graphs(report(post, tmp_path / "r.html").read_text()) for trace in figure["data"]]
    modes = {trace["name"]: trace["mode"] for trace in traces if trace.get("name") in ("predicted", "estimate")}
    assert modes == {"predicted": "lines+markers", "estimate": "lines"}


def test_innovations_of_a_smoother_are_shown_once_as_those_of_its_filter(run, tmp_path):
    posts, x = run
    _, y = sp.simulate(model_of(), T, key=jax.random.key(3))
    both = {"filter": sp.filter(model_of(), y), "back": sp.smooth(model_of(), y)}
    html = report(both, tmp_path / "r.html").read_text()
    assert "Shown once: back has those of filter; a smoother's innovations are its filter's." in html
    names = [[trace.get("name") for trace in figure["data"]] for figure in graphs(html)]
    assert all({"filter", "back"} <= set(each) for each in names[:2])  # the states
    assert not any("back" in each for each in names[2:])
    assert "Shown once" not in report(posts, tmp_path / "r.html", truth=x).read_text()


def test_rows_on_both_sides_of_a_break_are_kept():
    curve, breaks = np.sin(np.arange(50_000.0)), np.array([7, 40_000])
    rows, ends = with_breaks(breaks, curve)
    assert rows.size <= POINTS
    np.testing.assert_array_equal(rows[ends], breaks)
    np.testing.assert_array_equal(rows[ends - 1], breaks - 1)
    assert with_breaks(np.arange(1, 50_000), curve)[1].size == 0


def test_single_precision_is_used_only_where_it_shows_the_same():
    assert compact(np.linspace(0, 1, 10)).dtype == np.float32
    assert compact(1e9 + np.linspace(0, 1, 10)).dtype == np.float64
    assert np.isnan(compact(np.full(3, np.nan))).all()


def test_axes_show_each_state_with_its_unit(run):
    posts, x = run
    axes = plot_states(posts["ukf"], np.arange(T), x)
    assert [ax.get_ylabel() for ax in axes] == ["<b>level</b> [m]", "rate"]
    axes[0].figure.canvas.draw()
    assert [t.get_text() for t in axes[0].figure.legends[0].get_texts()] == ["±2σ", "estimate", "truth"]
    mpl.pyplot.close(axes[0].figure)
    with pytest.raises(ValueError, match="truth must have the shape"):
        posts["ukf"].plot(truth=x[:3])
