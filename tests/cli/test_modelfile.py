"""What a model's file says of the columns of a log, and what becomes of it."""

import json
import re
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import sigmapoint as sp
from sigmapoint.cli import app, errors, modelfile

MODEL = """
import jax.numpy as jnp
import sigmapoint as sp

measurements, time = ["level", "flow"], "clock"
OTHER
model = sp.StateSpaceModel(
    lambda x, u: DYNAMICS, lambda x, u: x, 0.1 * jnp.eye(2), jnp.eye(2),
    sp.Gaussian(jnp.zeros(2), jnp.eye(2)), observation_names=("level", "flow"),
)
"""
DATA = "clock,level [m],flow\n0,1.0,0.1\n0.5,,0.2\n2.5,1.2,0.3\n"
DATES = DATA.replace("0,1", "2024-01-01 12:00:00,1").replace("\n0.5", "\n2024-01-01 12:01").replace("2.5", "2024-01-02")


@pytest.fixture
def files(tmp_path):
    def write(other="", dynamics="x", data=DATA):
        (tmp_path / "tank.py").write_text(MODEL.replace("OTHER", other).replace("DYNAMICS", dynamics))
        (tmp_path / "tank.csv").write_text(data)
        return tmp_path / "tank.py", tmp_path / "tank.csv"

    return write


@pytest.mark.parametrize("columns", ["'flow', 'level'", "'flow', 'Level [m]'", "'flow', 'clock'"])
def test_a_list_of_measurements_in_another_order_than_the_model_has_is_refused(files, columns):
    with pytest.raises(errors.InputError, match="in the order of the model's observation_names, level, flow, got flow"):
        modelfile.load(*files(f"measurements = [{columns}]"))


def test_a_dict_of_measurements_goes_by_name(files):
    y = modelfile.load(*files("measurements = {'flow': 'flow', 'level': 'level'}")).y
    np.testing.assert_array_equal(y, modelfile.load(*files()).y)


@pytest.mark.parametrize(("data", "expected"), [(DATA, [0.5, 2.0, 0.0]), (DATES, [60.0, 43140.0, 0.0])])
def test_the_time_to_the_next_row_is_an_input(files, data, expected):
    problem = modelfile.load(*files("interval = 'dt'\ninputs = {'push': 'flow'}", data=data))
    np.testing.assert_allclose(problem.u["dt"], expected)
    assert set(problem.u) == {"dt", "push"}


def test_rows_without_a_time_are_one_sample_apart(files):
    np.testing.assert_array_equal(modelfile.load(*files("time, interval = None, 'dt'")).u["dt"], [1.0, 1.0, 0.0])


@pytest.mark.parametrize(("key", "inputs"), [("'push'", "{'push': 'flow'}"), ("'flow'", "['flow']"), ("3", "['flow']")])
def test_the_time_to_the_next_row_has_a_key_of_its_own(files, key, inputs):
    with pytest.raises(errors.InputError, match="`interval` must be a key of u that no column"):
        modelfile.load(*files(f"interval = {key}\ninputs = {inputs}"))


@pytest.mark.parametrize(("build", "why"), [("lambda u: model", "too many positional"), ("3", "not a callable")])
def test_a_model_is_built_from_inputs_and_time(files, build, why):
    path, data = files()
    path.write_text(path.read_text().replace("\nmodel =", "\nmade =") + f"\nbuild = {build}\n")
    with pytest.raises(errors.InputError, match=rf"tank.py: `build` must be .* build\(u, time\): .*{why}"):
        modelfile.load(path, data)


def test_a_step_of_its_own_length_is_what_the_model_sees(files, tmp_path):
    model, data = files("interval = 'dt'", "jnp.stack([x[0] + u['dt'] * x[1], x[1]])")
    assert CliRunner().invoke(app, ["run", str(model), str(data), "--out", str(tmp_path)]).exit_code == 0
    problem = modelfile.load(model, data)
    post = sp.filter(problem.model, problem.y, {"dt": np.array([0.5, 2.0, 0.0])})
    np.testing.assert_allclose(pd.read_parquet(tmp_path / "estimates.parquet")["x0"], post.mean[:, 0], rtol=1e-6)


def test_estimates_that_are_no_numbers_are_written_and_said_in_a_line(files, tmp_path):
    """In a process of its own: the lines of warnings are those of the command line as a whole."""
    model, data = files("import warnings; warnings.warn('mind the step')", dynamics="jnp.sqrt(x - 9)")
    run = [sys.executable, "-m", "sigmapoint", "run", str(model), str(data), "--out", str(tmp_path)]
    done = subprocess.run(run, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    first, second = done.stderr.strip().splitlines()
    assert re.fullmatch(r"warning: mind the step \(.*tank.py, line 6\)", first)
    assert re.fullmatch("warning: the log-likelihood is not finite: .* where to look", second)
    assert json.loads((tmp_path / "summary.json").read_text())["log_likelihood"] is None
    assert pd.read_parquet(tmp_path / "estimates.parquet")["x0"].isna().any()
    assert (tmp_path / "report.html").is_file()
