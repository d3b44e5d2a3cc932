"""Tables carry every field under its name, with units, and refuse what does not fit."""

import dataclasses
from dataclasses import fields
from datetime import UTC, datetime, timedelta, timezone

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

import sigmapoint as sp
from sigmapoint.printing import estimate
from sigmapoint.results import Labels
from sigmapoint.tables import instants, to_frame, to_xarray

T = 6


@pytest.fixture(scope="module")
def post():
    model = sp.StateSpaceModel(
        lambda x, u: 0.9 * x,
        lambda x, u: x[:1],
        jnp.eye(2),
        jnp.eye(1),
        sp.Gaussian(jnp.zeros(2), jnp.eye(2)),
        state_names=("soc", "volt"),
        state_units=("1", "V"),
        observation_names=("volt",),
        observation_units=("V",),
    )
    y = jnp.arange(float(T))[:, None].at[2, 0].set(jnp.nan)
    return sp.filter(model, y, {"current": jnp.ones(T)})


@pytest.fixture(scope="module")
def compass(unit_vector):
    return sp.filter(*unit_vector(T))


def test_dataset_has_every_field_under_its_name(post):
    data = to_xarray(post, np.arange(T) * 0.5)
    assert dict(data["cov"].sizes) == {"time": T, "state": 2, "state2": 2}
    assert dict(data["innovation"].sizes) == {"time": T, "observation": 1}
    np.testing.assert_array_equal(data["mean"].sel(state="volt"), post.mean[:, 1])
    np.testing.assert_array_equal(data["u"].sel(input="current"), np.ones(T))
    assert data["mean"].attrs["units"] == ["1", "V"]
    assert list(data["observation_unit"].values) == ["V"]
    assert data["time"].values[-1] == 2.5
    assert data.attrs["log_likelihood"] == float(post.log_likelihood)
    assert list(post.to_frame().columns) == list(to_frame(post).columns)
    assert list(post.to_xarray().data_vars) == list(data.data_vars)


def test_frame_has_plain_columns_with_units(post):
    frame = to_frame(post)
    assert list(frame.columns) == [
        *("soc", "volt", "soc std", "volt std"),
        *("volt measured", "volt innovation", "volt innovation std", "nis"),
    ]
    assert frame.attrs["units"] == dict(zip(frame.columns, ["1", "V", "1", "V", "V", "V", "V", "1"]))
    np.testing.assert_array_equal(frame["volt std"], post.std[:, 1])
    assert np.isnan(frame["volt innovation"][2])


def test_units_survive_a_parquet_file(post, tmp_path):
    frame = to_frame(post, pd.date_range("2024-01-01", periods=T, freq="s"))
    frame.to_parquet(tmp_path / "estimates.parquet")
    again = pd.read_parquet(tmp_path / "estimates.parquet")
    assert again.attrs == frame.attrs
    pd.testing.assert_frame_equal(again, frame, check_freq=False)


def test_what_was_not_kept_is_left_out(post):
    few = jax.tree.map(lambda a: a, post)
    few = type(post)(**{f.name: getattr(few, f.name) for f in fields(post)} | {"cov": None, "nis": None})
    assert "cov" not in to_xarray(few)
    assert "nis" not in to_frame(few)


def test_fewer_degrees_of_freedom_than_elements_get_names_of_their_own():
    sphere = sp.Manifold(lambda a, b: (a - b)[:1], lambda m, d: m + jnp.concatenate([d, jnp.zeros(1)]))
    model = sp.StateSpaceModel(
        lambda x, u: x,
        lambda x, u: x[:1],
        jnp.eye(1),
        jnp.eye(1),
        sp.Gaussian(jnp.ones(2), jnp.eye(1)),
        state_space=sphere,
    )
    post = sp.filter(model, jnp.ones((3, 1)))
    assert list(to_frame(post).columns)[:3] == ["x0", "x1", "d0 std"]
    assert dict(to_xarray(post)["cov"].sizes) == {"time": 3, "tangent": 1, "tangent2": 1}


def test_innovations_of_one_degree_of_freedom_of_a_unit_vector(compass):
    data, frame = compass.to_xarray(), to_frame(compass)
    assert dict(data["y"].sizes) == {"time": T, "observation": 2}
    assert dict(data["innovation_cov"].sizes) == {"time": T, "observation_tangent": 1, "observation_tangent2": 1}
    assert (data["y"].attrs["units"], data["innovation"].attrs["units"]) == (["V", "V"], [""])
    assert list(frame.columns)[2:6] == ["east measured", "north measured", "e0 innovation", "e0 innovation std"]
    assert frame.attrs["units"]["e0 innovation"] == ""
    np.testing.assert_array_equal(data["innovation"].sel(observation_tangent="e0"), frame["e0 innovation"])


def test_differences_on_a_manifold_of_as_many_elements_keep_names_and_lose_units():
    labels = Labels(("gain",), ("V",), ("level",), ("m",), sp.Manifold(lambda a, b: jnp.log(a / b), lambda m, d: m))
    assert labels.directions(1) == (("gain",), ("",))
    assert labels.innovations(1) == (("level",), ("m",))


def test_a_result_is_printed_in_a_few_lines(post, compass):
    text = str(post)
    lines = text.splitlines()
    assert lines[0] == "6 samples, 2 states, 1 measured quantity"
    assert f"{float(post.log_likelihood):.4g}" in lines[1]
    mean, std = float(post.mean[-1, 1]), float(post.std[-1, 1])
    assert lines[-1] == f"  volt  {mean:.2f} ± {std:.2f} V" or lines[-1] == f"  volt  {mean:.1f} ± {std:.1f} V"
    assert lines[-2].startswith("  soc   ")
    assert not lines[-2].endswith(" 1")
    assert "heading" in str(compass)


def test_many_states_are_printed_in_part():
    eye = jnp.eye(9)
    model = sp.StateSpaceModel(lambda x, u: x, lambda x, u: x, eye, eye, sp.Gaussian(jnp.zeros(9), eye))
    text = str(sp.filter(model, jnp.full((2, 9), jnp.nan), method=sp.ekf()))
    assert len(text.splitlines()) == 11
    assert text.endswith("and 3 more")
    assert "nothing was measured" in text


@pytest.mark.parametrize(
    ("mean", "std", "text"),
    [
        (0.12345, 0.0041, "0.1235 ± 0.0041"),
        (41.23, 2.1, "41.2 ± 2.1"),
        (1234.5, 321.0, "1234 ± 321"),
        (1.5, 0.0, "1.5 ± 0"),
        (1e12, 3e10, "1e+12 ± 3e+10"),
        (0.70711, np.nan, "0.7071"),
    ],
)
def test_an_estimate_has_the_digits_that_its_error_bar_allows(mean, std, text):
    assert estimate(mean, std) == text


def test_what_cannot_be_summed_up_is_printed_by_its_fields(post):
    seen = []
    jax.jit(lambda post: seen.append(str(post)))(post)
    batch = jax.tree.map(lambda a: a[None], post)
    few = dataclasses.replace(post, nis=None)
    seen += [str(batch), str(few), str(jax.tree.structure(post).unflatten([None] * len(jax.tree.leaves(post))))]
    assert all(text.startswith("Posterior(") for text in seen)
    assert len(seen) == 4


def test_wrong_time_and_batches_are_refused(post):
    with pytest.raises(ValueError, match="one value for each of the 6 rows"):
        to_xarray(post, np.arange(5))
    with pytest.raises(ValueError, match="1 missing value"):
        to_frame(post, [0.0, 1.0, np.nan, 3.0, 4.0, 5.0])
    with pytest.raises(ValueError, match="numbers or dates"):
        to_frame(post, list("abcdef"))
    batch = jax.tree.map(lambda a: a[None], post)
    for table in (to_xarray, to_frame):
        with pytest.raises(ValueError, match="batch of shape"):
            table(batch)


def test_dates_of_every_kind_are_understood():
    plain = np.array(["2024-01-01T00:00:00", "2024-01-01T00:00:01"], "datetime64[us]")
    dates = [datetime(2024, 1, 1, tzinfo=UTC) + timedelta(seconds=k) for k in range(2)]
    east = [d.astimezone(timezone(timedelta(hours=5))) for d in dates]
    zoned = pd.Series(pd.date_range("2024-01-01", periods=2, freq="s", tz="Europe/Berlin")).dt.tz_convert("UTC")
    for given in (plain, dates, east, [d.isoformat() for d in dates]):
        np.testing.assert_array_equal(instants(given, 2), plain)
    assert (np.diff(instants(zoned, 2)) == np.timedelta64(1, "s")).all()
