"""The table of methods: what is in a row, what happens to a method that refuses, and what is refused as a whole."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sigmapoint as sp
from sigmapoint.comparison import MOST_COLUMNS, STANDARD, compare

LINEAR = {"ekf": sp.ekf(), "srukf": sp.srukf(), "cdkf": sp.cdkf()}


def walk(n=2, **options):
    return sp.StateSpaceModel(
        dynamics=lambda x, u: 0.9 * x,
        observation=lambda x, u: x,
        process_noise=0.1 * jnp.eye(n),
        observation_noise=jnp.eye(n),
        initial=sp.Gaussian(jnp.zeros(n), jnp.eye(n)),
        **options,
    )


@pytest.fixture(scope="module")
def drawn():
    model = walk()
    x, y = sp.simulate(model, 400, key=jax.random.key(1))
    return model, x, y


@pytest.fixture(scope="module")
def linear(drawn):
    model, x, y = drawn
    return compare(model, y, methods=LINEAR, truth=x)


def test_on_a_linear_model_every_method_is_the_kalman_filter(linear):
    columns = ("rmse x0", "rmse x1", "coverage_2sigma", "nis_per_element", "log_likelihood")
    for row in linear.rows[1:]:
        assert [row[c] for c in columns] == pytest.approx([linear.rows[0][c] for c in columns], rel=1e-10)


def test_errors_and_coverage_are_those_computed_by_hand(drawn, linear):
    model, x, y = drawn
    post = sp.filter(model, y, method=sp.ekf())
    error, row = np.asarray(post.mean - x), linear.rows[0]
    assert row["rmse x0"] == pytest.approx(np.sqrt(np.mean(error[:, 0] ** 2)), rel=1e-12)
    assert row["coverage_2sigma"] == pytest.approx(np.mean(abs(error) <= 2 * np.asarray(post.std)))
    assert row["nis_per_element"] == pytest.approx(float(post.nis.sum()) / 800)
    assert abs(row["nis_per_element"] - 1) < 4 * np.sqrt(2 / 800)
    assert abs(row["coverage_2sigma"] - 0.954) < 0.05


def test_posteriors_are_kept_and_time_is_positive(drawn, linear):
    model, _, y = drawn
    assert list(linear.posteriors) == list(LINEAR)
    assert np.array_equal(linear.posteriors["srukf"].mean, sp.filter(model, y, method=sp.srukf()).mean)
    assert all(row["us_per_step"] > 0 and row["compile_s"] >= 0 for row in linear.rows)


def test_smoothed_estimates_err_less_and_keep_the_innovations_of_the_filter(drawn, linear):
    model, x, y = drawn
    smoothed = compare(model, y, methods={"ekf": sp.ekf()}, truth=x, smooth=True).rows[0]
    assert smoothed["rmse x0"] < linear.rows[0]["rmse x0"]
    assert smoothed["nis_per_element"] == pytest.approx(linear.rows[0]["nis_per_element"], rel=1e-10)


def test_nis_is_counted_by_what_was_measured(drawn):
    model, _, y = drawn
    y = y.at[::2, 0].set(jnp.nan).at[:50].set(jnp.nan)
    row = compare(model, y, methods={"ekf": sp.ekf()}).rows[0]
    post = sp.filter(model, y, method=sp.ekf())
    assert row["nis_per_element"] == pytest.approx(float(post.nis.sum()) / int((~jnp.isnan(y)).sum()))
    assert not any(name.startswith(("rmse", "coverage")) for name in row)
    nothing = compare(model, y[:50], methods={"ekf": sp.ekf()}).rows[0]
    assert np.isnan(nothing["nis_per_element"])
    assert nothing["log_likelihood"] == 0.0


def test_a_method_that_refuses_is_a_row_with_its_message(drawn):
    model, x, y = drawn
    table = compare(model, y, methods={"huge": sp.ghkf(100), "ekf": sp.ekf()}, truth=x)
    assert "100**2 points" in table.rows[0]["note"]
    assert list(table.posteriors) == ["ekf"]
    assert "100**2 points" in str(table)


def test_a_method_that_diverges_says_from_which_row():
    model = sp.StateSpaceModel(
        lambda x, u: x + jnp.log(u),
        lambda x, u: x,
        jnp.eye(1),
        jnp.eye(1),
        sp.Gaussian(jnp.zeros(1), jnp.eye(1)),
    )
    table = compare(model, jnp.ones((5, 1)), jnp.array([1.0, 1.0, -1.0, 1.0, 1.0]), {"ekf": sp.ekf()})
    assert table.rows[0]["note"] == "not finite from row 3"


def test_table_is_aligned_and_frame_has_one_row_a_method(linear):
    lines = str(linear).splitlines()
    assert len(lines) == 2 + len(LINEAR)
    assert lines[0].startswith("method")
    assert "note" not in lines[0]
    assert len({len(line) for line in lines}) == 1
    assert list(linear.to_frame().index) == list(LINEAR)


def test_default_is_the_eleven_standard_methods_and_a_grid_that_is_too_large_is_a_row_with_its_message():
    _, y = sp.simulate(walk(8), 3, key=jax.random.key(0))
    table = compare(walk(8), y)
    notes = {row["method"]: row["note"] for row in table.rows}
    assert tuple(notes) == STANDARD
    assert len(STANDARD) == 11
    assert {name for name, note in notes.items() if "3**8 points" in note} == {"ghkf", "srghkf"}


def test_a_model_that_does_not_fit_one_method_is_compared_with_the_others():
    """An angle too wide for sigma points, which the default method would refuse, is none for a derivative."""
    model = sp.StateSpaceModel(
        lambda x, u: x,
        lambda x, u: jnp.sin(x),
        0.1 * jnp.eye(1),
        jnp.eye(1),
        sp.Gaussian(jnp.zeros(1), 16.0 * jnp.eye(1)),
        state_space=sp.angles(0),
    )
    table = compare(model, jnp.zeros((5, 1)), methods={"ekf": sp.ekf(), "ukf": sp.ukf(), "srcdkf": sp.srcdkf()})
    assert list(table.posteriors) == ["ekf"]
    assert all("too wide for its space" in row["note"] for row in table.rows[1:])


def test_errors_of_angles_are_taken_the_short_way_round():
    model = walk(1, state_space=sp.angles(0, period=360.0), observation_space=sp.angles(0, period=360.0))
    y = jnp.zeros((20, 1))
    row = compare(model, y, methods={"ekf": sp.ekf()}, truth=jnp.full((20, 1), 360.0)).rows[0]
    assert row["rmse x0"] < 1e-9


def test_truth_may_be_known_for_some_states_at_some_times(drawn):
    model, x, y = drawn
    truth = np.array(x)
    truth[:, 1] = np.nan
    truth[:100, 0] = np.nan
    row = compare(model, y, methods={"ekf": sp.ekf()}, truth=truth).rows[0]
    error = np.asarray(sp.filter(model, y, method=sp.ekf()).mean - x)[100:, 0]
    assert row["rmse x0"] == pytest.approx(np.sqrt(np.mean(error**2)))
    assert "rmse x1" not in row


def test_many_states_share_one_error():
    n = MOST_COLUMNS + 1
    x, y = sp.simulate(walk(n), 20, key=jax.random.key(0))
    row = compare(walk(n), y, methods={"ekf": sp.ekf()}, truth=x).rows[0]
    assert [name for name in row if name.startswith("rmse")] == ["rmse"]


def test_one_row_of_data(drawn):
    model, x, y = drawn
    assert compare(model, y[:1], methods={"ekf": sp.ekf()}, truth=x[:1]).rows[0]["note"] == ""


def test_input_that_fits_no_method_is_refused_as_a_whole(drawn):
    model, x, y = drawn
    with pytest.raises(ValueError, match=r"truth must have the shape of the estimates, \(400, 2\)"):
        compare(model, y, methods=LINEAR, truth=x[:, :1])
    with pytest.raises(ValueError, match="methods is empty"):
        compare(model, y, methods={})
    with pytest.raises(ValueError, match="y must be"):
        compare(model, y[:, 0])
