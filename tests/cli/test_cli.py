"""The command line in-process: what it writes, and one clear message without a traceback for what is wrong."""

import json
import math
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import jax
import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import sigmapoint as sp
from sigmapoint.cli import app, modelfile, output
from sigmapoint.cli.expressions import parse_method, parse_methods
from sigmapoint.experiments.publishing.results import Claim, Row, publish

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
MODEL = """
import jax.numpy as jnp
import sigmapoint as sp

measurements = ["level"]
inputs = {"pump": "pump"}
model = sp.StateSpaceModel(
    lambda x, u: 0.9 * x + u["pump"], lambda x, u: x, 0.1 * jnp.eye(1), jnp.eye(1),
    sp.Gaussian(jnp.zeros(1), jnp.eye(1)), state_names=("tank",),
)
"""
FEW = "level [m],pump\n1.0,0.1\n,0.1\n1.2,0.2\n"
KINDS = ("filter", "smoother", "gradient")
FILES = {"estimates.parquet", "summary.json", "report.html"}


@pytest.fixture
def files(tmp_path):
    """Writes MODEL.py and a data file; returns their paths."""

    def write(data=FEW, model=MODEL, name="data.csv"):
        (tmp_path / "tank.py").write_text(model)
        (tmp_path / name).write_text(data)
        return str(tmp_path / "tank.py"), str(tmp_path / name)

    return write


def invoke(*args, code=0):
    result = CliRunner().invoke(app, [str(a) for a in args])
    assert result.exit_code == code, result.output + repr(result.exception)
    return result


def message(*args, code=2):
    """The one message of a command that fails; no traceback."""
    text = invoke(*args, code=code).stderr
    assert "Traceback" not in text
    return " ".join(text.split())


@pytest.mark.parametrize("command", [(), ("demo",), ("run",), ("compare",), ("bench",), ("reproduce",)])
def test_help_and_version(command):
    assert "Usage" in invoke(*command, "--help").stdout
    assert invoke("--version").stdout == f"sigmapoint {sp.__version__}\n"


def test_run_on_the_example_writes_three_files_with_names_and_units(tmp_path):
    out = tmp_path / "new" / "folder"
    shown = invoke(
        "run", EXAMPLES / "pendulum.py", EXAMPLES / "pendulum.csv", "--method", "srukf", "--smooth", "--out", out
    ).stdout
    assert "angle" in shown
    assert {p.name for p in out.iterdir()} == FILES
    summary = json.loads((out / "summary.json").read_text(), parse_constant=pytest.fail)
    assert summary["T"] == 300
    assert summary["dtype"] == "float64"
    assert summary["states"] == {"angle": "rad", "speed": "rad/s"}
    assert summary["measurements"] == {"position": "m", "gyro": "rad/s"}
    assert abs(summary["nis"]["per_element"] - 1) < 4 * np.sqrt(2 / summary["nis"]["measured_elements"])
    frame = pd.read_parquet(out / "estimates.parquet")
    assert frame.attrs["units"]["time"] == "s"
    truth = pd.read_csv(EXAMPLES / "pendulum.csv")["true angle [rad]"]
    late = slice(50, None)
    assert np.sqrt(np.mean((frame["angle"] - truth)[late] ** 2)) < 0.05
    assert summary["final"][0]["estimate"] == frame["angle"].iloc[-1]


@pytest.mark.parametrize(("time", "label"), [("", "time [samples]"), ("time = 'clock'\n", "time [min]")])
@pytest.mark.parametrize("command", [("run", "--method"), ("compare", "--methods")])
def test_the_page_says_the_unit_of_time(files, tmp_path, command, time, label):
    data = "level [m],pump,clock [min]\n1.0,0.1,0\n,0.1,1\n1.2,0.2,2\n"
    invoke(command[0], *files(data, MODEL + time), command[1], "ekf", "--out", tmp_path / "out")
    html = (tmp_path / "out" / "report.html").read_text()
    assert set(re.findall(r'"title":\{"text":"(time[^"]*)"', html)) == {label}


def test_command_line_agrees_with_the_library(files, tmp_path):
    model, data = files()
    invoke("run", model, data, "--method", "iterated(srukf(), 2)", "--out", tmp_path / "out")
    frame = pd.read_parquet(tmp_path / "out" / "estimates.parquet")
    names = {}
    exec(MODEL, names)
    u = {"pump": jax.numpy.array([0.1, 0.1, 0.2])}
    post = sp.filter(names["model"], [[1.0], [np.nan], [1.2]], u, sp.iterated(sp.srukf(), 2))
    assert np.array_equal(frame["tank"], post.mean[:, 0])
    assert frame.attrs["units"]["level measured"] == "m"
    assert list(frame["time"]) == [0, 1, 2]


def test_build_sees_inputs_and_time_and_parquet_with_dates_in_float32(tmp_path):
    (tmp_path / "tank.py").write_text(
        MODEL.replace("model = ", "def build(u, time):\n  assert time.tolist() == [0, 60, 120]\n  return ").replace(
            "0.1 * jnp.eye(1)", "jnp.asarray(u['pump'])[:, None, None]"
        )
        + "time = 'stamp'\ntruth = {'tank': 'TRUE'}\nmeasurements = {'sensor': 'Level(m)'}\n"
    )
    stamps = pd.date_range("2024-01-01", periods=3, freq="min")
    table = {"stamp": stamps, "LEVEL (m)": [1.0, np.nan, 1.2], "pump": [0.1, 0.1, 0.2], "true (m)": [1.0, 1.0, 1.1]}
    pd.DataFrame(table).to_parquet(tmp_path / "data.parquet")
    invoke("run", tmp_path / "tank.py", tmp_path / "data.parquet", "--float32", "--out", tmp_path / "out")
    frame = pd.read_parquet(tmp_path / "out" / "estimates.parquet")
    assert frame["tank"].dtype == np.float32
    assert list(frame["time"]) == list(stamps)
    assert frame.attrs["units"]["tank"] == "m"
    assert "sensor innovation" in frame
    assert jax.config.read("jax_enable_x64")


def test_one_row_that_was_not_measured(files, tmp_path):
    invoke("run", *files("level,pump\n,0.1\n"), "--out", tmp_path / "out")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["T"] == 1
    assert summary["nis"]["per_element"] is None


def test_particle_filters_draw_by_the_seed(files, tmp_path):
    given = files()
    for seed in (0, 1):
        out = ("--out", tmp_path / str(seed))
        invoke("run", *given, "--method", "bootstrap(100)", "--smooth", "--seed", seed, *out)
    one, two = (json.loads((tmp_path / seed / "summary.json").read_text())["log_likelihood"] for seed in "01")
    assert one != two
    options = ("--methods", "ekf,bootstrap(50)", "--out", tmp_path / "both")
    assert " ess " in invoke("compare", *given, *options).stdout
    assert "no gradient" not in invoke("bench", *given, *options, "--repetitions", 1).stdout


def test_compare_shows_a_method_that_refuses_beside_the_others(files, tmp_path):
    shown = invoke("compare", *files(), "--methods", "ekf, ghkf(6000)", "--out", tmp_path / "out").stdout
    assert "6000**1 points" in shown
    rows = json.loads((tmp_path / "out" / "summary.json").read_text())["rows"]
    assert [row["method"] for row in rows] == ["ekf", "ghkf(6000)"]
    assert set(pd.read_parquet(tmp_path / "out" / "estimates.parquet")["method"]) == {"ekf"}
    assert "no method could run" in message("compare", *files(), "--methods", "ghkf(6000)", "--out", tmp_path / "out")


def test_bench_times_every_method_that_runs(files, tmp_path):
    options = ("--methods", "ekf, ghkf(6000)", "--repetitions", 2, "--out", tmp_path / "out")
    shown = invoke("bench", *files(), *options).stdout
    assert "6000**1 points" in shown
    found = json.loads((tmp_path / "out" / "bench.json").read_text())
    times = found["rows"][0]
    assert all(times[f"{kind} µs/row"] > 0 for kind in KINDS)
    assert times["live p99 µs"] >= times["live µs"] > 0
    assert times["first call s"] > times["filter µs/row"] * 3e-6
    assert {kind: len(each) for kind, each in found["us_per_row"]["ekf"].items()} == dict.fromkeys(KINDS, 2)
    assert list(found["rows"][1]) == ["method", "note"]
    assert "no method could run" in message("bench", *files(), "--methods", "ghkf(6000)", "--out", tmp_path / "none")
    assert not (tmp_path / "none").exists()


BOX = """
import numpy as np, jax.numpy as jnp, sigmapoint as sp
model = sp.StateSpaceModel(
    sp.blackbox(lambda x, u: 0.9 * np.asarray(x)), lambda x, u: x, 0.1 * jnp.eye(1), jnp.eye(1),
    sp.Gaussian(jnp.zeros(1), jnp.eye(1)),
)
measurements = ["level [m]"]
"""


def test_a_black_box_is_compared_and_timed_as_far_as_a_method_goes(files, tmp_path):
    chosen = (*files(model=BOX), "--methods", "ekf,ukf", "--out", tmp_path / "out")
    assert "no derivative" in invoke("compare", *chosen).stdout
    assert set(pd.read_parquet(tmp_path / "out" / "estimates.parquet")["method"]) == {"ukf"}
    assert "no derivative" in invoke("bench", *chosen, "--repetitions", 1).stdout
    ekf, ukf = json.loads((tmp_path / "out" / "bench.json").read_text())["rows"]
    assert list(ekf) == ["method", "note"]
    assert {"filter µs/row", "smoother µs/row"} <= set(ukf)
    assert "gradient µs/row" not in ukf


def test_programs_are_kept_between_runs_in_the_cache_folder_of_the_user(files, tmp_path):
    kept = {key: value for key, value in os.environ.items() if not key.startswith("JAX_")}
    environment = kept | {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    command = [sys.executable, "-m", "sigmapoint", "run", *files(), "--method", "ekf", "--out", str(tmp_path / "out")]

    def ran():
        shown = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        assert not re.search("warning|error", shown.stderr, re.IGNORECASE), shown.stderr
        estimates = pd.read_parquet(tmp_path / "out" / "estimates.parquet")
        programs = {path for path in (tmp_path / "cache" / "sigmapoint").rglob("*") if path.name.endswith("-cache")}
        return estimates, programs

    first, programs = ran()
    assert programs
    second, later = ran()
    assert later == programs
    pd.testing.assert_frame_equal(first, second, check_exact=True)
    (tmp_path / "a file").touch()
    environment["XDG_CACHE_HOME"] = str(tmp_path / "a file")  # where no folder can be, nothing is kept, nor said
    third, _ = ran()
    pd.testing.assert_frame_equal(first, third, check_exact=True)


def test_demo_with_two_methods(tmp_path):
    shown = invoke("demo", "--methods", "ekf,srcdkf", "--out", tmp_path / "demo").stdout
    assert "srcdkf" in shown
    assert "looked at" in " ".join(shown.split())
    assert {p.name for p in (tmp_path / "demo").iterdir()} == FILES
    methods = json.loads((tmp_path / "demo" / "summary.json").read_text(), parse_constant=pytest.fail)["methods"]
    assert all(m["soc_rms_points"] < 2 and 90 < m["coverage_percent"] < 99.5 for m in methods.values())


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ("", "is empty"),
        ("level,pump\n", "has a header ('level', 'pump') but no rows"),
        ("height,pump\n1,2\n", "no column 'level' in the data, which has 'height', 'pump'"),
        ("level;pump\n1;2\n", "another separator"),
        ("level [m],level [mm],pump\n1,1000,2\n", "ambiguous, it matches 'level [m]', 'level [mm]'"),
        ("level,level,pump\n1,1,2\n", "ambiguous, it matches 'level', 'level'"),
        ("level [m],pump\n1,2\nlow,2\n", "column 'level [m]' must be numbers, but holds 'low' in data row 2"),
        ("level,pump\n1,2\n1,\n", "inputs 'pump': column 'pump' is empty in data row 2"),
        ("level,pump\n1,2\ninf,2\n", "column 'level' is infinite in data row 2"),
        ("level,pump\n1,2\n1,2,3\n", "cannot be read as CSV"),
        ("level,pump\n1,2,3\n1,2,3\n", "cannot be read as CSV"),
    ],
)
def test_bad_data_gets_one_message_that_says_where(files, tmp_path, data, said):
    assert said in message("run", *files(data), "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("model", "said"),
    [
        (MODEL + "1 / 0\n", "tank.py, line 11: ZeroDivisionError: division by zero"),
        ("def f(:\n", "tank.py, line 1: invalid syntax"),
        (MODEL.replace("model =", "tank ="), "must define either `model` or `build(u, time)`; it has neither"),
        (MODEL + "model = 3\n", "`model` must be a sp.StateSpaceModel, got int"),
        (MODEL + "measurements = 3\n", "`measurements` must be a dict of names to columns, or a list"),
        (MODEL + "measurements = []\n", "must define `measurements`"),
        (MODEL + "import time\n", "`time` must be the name of a column, got module"),
        (MODEL + "time = 'pump'\n", "column 'pump' goes back in data row 3"),
        (MODEL + "time = 'day'\n", "dates like 2024-01-31 12:00): column 'day' must be numbers, but holds 'Monday'"),
        (MODEL + "truth = {'tonk': 'pump'}\n", "'tonk', no state of the model; its state_names are tank"),
        (
            MODEL.replace('u["pump"]', 'u["pomp"]'),
            "tank.py, line 8: KeyError: 'pomp'; dynamics was called with a u that has the keys 'pump'",
        ),
        (MODEL.replace("jnp.eye(1),", "-jnp.eye(1),", 1), "has a negative variance"),
        (MODEL + "measurements = ['level', 'pump']\n", "y has 2 element(s) a row, but observation returns 1"),
    ],
)
def test_bad_model_gets_one_message_that_says_where(files, tmp_path, model, said):
    assert said in message(
        "run", *files("level [m],pump,day\n1.0,0.1,Monday\n,0.1,\n1.2,0.0,\n", model), "--out", tmp_path / "out"
    )
    assert not (tmp_path / "out").exists()


def test_files_that_are_not_there_or_of_another_kind(files, tmp_path):
    model, data = files()
    assert "no such file" in message("run", model, tmp_path / "none.csv")
    assert "data.csv is data, not Python: the order is MODEL.py, then DATA" in message("run", data, model)
    assert "none.py: no such file" in message("run", tmp_path / "none.py", data)
    (tmp_path / "data.xlsx").write_bytes(b"")
    assert "data must be .csv" in message("run", model, tmp_path / "data.xlsx")
    (tmp_path / "bad.parquet").write_bytes(b"no parquet")
    assert "is not a Parquet file" in message("run", model, tmp_path / "bad.parquet")
    (tmp_path / "bad.csv.gz").write_bytes(b"no gzip")
    assert "cannot be read as CSV" in message("run", model, tmp_path / "bad.csv.gz")
    (tmp_path / "latin.csv").write_bytes("level,pump,°C\n1,2,3\n".encode("latin-1"))
    assert "is not UTF-8" in message("run", model, tmp_path / "latin.csv")


@pytest.mark.parametrize("command", ["run", "compare"])
def test_out_that_cannot_be_a_folder_is_found_before_anything_is_computed(files, tmp_path, command):
    (tmp_path / "taken").write_text("mine")
    for out in (tmp_path / "taken", tmp_path / "taken" / "below"):
        assert "is a file; name a folder" in message(command, *files(), "--out", out)
    assert (tmp_path / "taken").read_text() == "mine"


@pytest.mark.parametrize(("error", "code"), [(OSError(28, "No space left on device"), 2), (KeyboardInterrupt(), 130)])
def test_a_failure_while_writing_leaves_older_results_and_nothing_half_written(
    files, tmp_path, monkeypatch, error, code
):
    out, args = tmp_path / "out", files()
    out.mkdir()
    (out / "summary.json").write_text("older")

    def fails(result, **options):
        def write(file):
            file.write(b"half")
            raise error

        return write

    monkeypatch.setattr(output, "page_file", fails)
    text = message("run", *args, "--method", "ekf", "--out", out, code=code)
    assert ("No space left" if code == 2 else "interrupted") in text
    assert [(p.name, p.read_text()) for p in out.iterdir()] == [("summary.json", "older")]
    message("run", *args, "--method", "ekf", "--out", tmp_path / "a" / "b", code=code)
    assert not (tmp_path / "a").exists()


def test_an_unexpected_error_is_one_line_and_debug_shows_it_all(files, monkeypatch):
    def fails(*args):
        raise RuntimeError("out of luck")

    monkeypatch.setattr(modelfile, "load", fails)
    assert "RuntimeError: out of luck (run again with --debug" in message("run", *files(), code=1)
    result = CliRunner().invoke(app, ["run", *files(), "--debug"])
    assert isinstance(result.exception, RuntimeError)


def test_methods_are_parsed_as_written():
    assert parse_method("srukf") == sp.srukf()
    assert parse_method(" ukf(alpha=1e-3, kappa=-0.5) ") == sp.ukf(alpha=1e-3, kappa=-0.5)
    assert parse_method("iterated(srukf(),3)") == sp.iterated(sp.srukf(), 3)
    assert parse_method("augmented(ukf)") == sp.augmented(sp.ukf())
    assert parse_method("auxiliary(bootstrap(10))") == sp.auxiliary(sp.bootstrap(10))
    assert list(parse_methods("ekf, iterated(ukf(1.0, 2.0), 2)")) == ["ekf", "iterated(ukf(1.0, 2.0), 2)"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("srufk", "Did you mean srukf? Methods: ekf, "),
        ("__import__('os').system('true')", "only method names"),
        ("__import__", "unknown method '__import__'"),
        ("sp.srukf()", "only method names"),
        ("ukf(alpha=open('x'))", "is not a number"),
        ("ukf(alpha=True)", "is not a number"),
        ("ukf(**{})", "** is not allowed"),
        ("ukf(*[1])", "is not a number"),
        ("ukf(alfa=1)", "its arguments are (alpha=1, beta=2, kappa=0)"),
        ("bootstrap", "its arguments are (particles)"),
        ("bootstrap(0)", "particles must be a whole number of at least 1"),
        ("auxiliary(ukf)", "the first argument must be a method, like auxiliary(upf(200))"),
        ("iterated(upf(10))", "the first argument must be a method, like iterated(srukf())"),
        ("iterated()", "its arguments are (method, iterations=3)"),
        ("iterated(3)", "only method names"),
        ("iterated(iterations=3, method=4)", "the first argument must be a method"),
        ("augmented(iterated(srukf(), 3))", "method augmented: an iterated method"),
        ("ghkf(order=1)", "order must be"),
        ("ghkf(1.5)", "order must be a whole number, got 1.5"),
        ("srukf(", "is not an expression"),
        ("(" * 5000, "is not an expression"),
        ("ekf\x00", "is not an expression"),
        ("", "is not an expression"),
    ],
)
def test_a_method_that_is_not_one_is_refused_and_never_evaluated(text, said):
    with pytest.raises(ValueError, match=re.escape(said)) as error:
        parse_method(text)
    assert len(str(error.value)) < 400


def test_lists_of_methods_with_gaps_or_twice_are_refused(files):
    assert "has an empty entry" in message("compare", *files(), "--methods", "ekf,,ukf")
    assert "names a method twice" in message("compare", *files(), "--methods", "ekf,ekf")
    assert "Did you mean" in message("demo", "--methods", "srufk")


@pytest.fixture
def experiments(monkeypatch):
    """Two that write a file and have one row; how often they ran."""
    ran = []

    def run(runs, seed, out, quick, *data):
        ran.append(out.name)
        out.mkdir(parents=True, exist_ok=True)
        (out / "data.txt").write_text(" ".join(map(str, data)))
        assert quick == (runs == 7)
        row = Row("toy", "error & slope", "UKF", 0.4, 0.5, math.nan, runs or 100)
        claim = Claim("half is < one", {"0.5": True, "on all sides": None if out.name == "game" else True})
        return publish(out, "A toy", claim, ["Nothing."], [row], [])

    known = {
        name: SimpleNamespace(name=name, description=f"about {name}", run=run, data=data)
        for name, data in (("toy", ""), ("game", "two files"))
    }
    monkeypatch.setattr("sigmapoint.experiments.EXPERIMENTS", known)
    return ran


def test_reproduce_lists_runs_and_says_where_files_are(experiments, tmp_path):
    assert "about toy" in invoke("reproduce", "--list").stdout
    shown = invoke("reproduce", "toy", "--quick", "--runs", 7, "--out", tmp_path).stdout
    assert all(text in shown for text in ("error", "0.5", "7"))
    assert "toy/results.json" in shown.replace("\n", "")
    shutil.rmtree(tmp_path / "toy")
    invoke("reproduce", "--all", "--jobs", 1, "--out", tmp_path)
    files = {"index.html", "results.json", "results.md", "results.tex"}
    assert {p.name for p in tmp_path.iterdir()} == {"toy", "game"} | files


def test_reproduce_all_leaves_an_index_of_claims_and_takes_up_what_was_broken_off(experiments, tmp_path):
    invoke("reproduce", "toy", "--out", tmp_path)
    invoke("reproduce", "--all", "--jobs", 1, "--resume", "--out", tmp_path)
    assert experiments == ["toy", "game"]
    index = (tmp_path / "index.html").read_text()
    assert "1 of 2 claims reproduced" in index
    assert "<td>half is &lt; one</td><td>not decided</td>" in index
    assert "half is &lt; one" in index
    assert "not decided by these runs: on all sides" in index
    assert 'href="game/report.html"' in index
    assert r"toy & error \& slope & UKF & $0.4$ & $0.5$ & -- & 100 \\" in (tmp_path / "results.tex").read_text()
    assert "| game | error & slope | UKF | 0.4 | 0.5 | – | 100 |" in (tmp_path / "results.md").read_text()
    assert len(json.loads((tmp_path / "results.json").read_text())) == 2
    run = json.loads((tmp_path / "toy" / "run.json").read_text())
    assert (run["seed"], run["runs"], run["quick"], run["data"]) == (0, None, False, None)
    assert run["seconds"] >= 0
    invoke("reproduce", "--all", "--jobs", 1, "--resume", "--seed", 1, "--out", tmp_path)
    (tmp_path / "toy" / "results.json").unlink()
    older = {**run, "seed": 1, "versions": run["versions"] | {"jax": "0.1"}}
    (tmp_path / "game" / "run.json").write_text(json.dumps(older))
    invoke("reproduce", "--all", "--jobs", 1, "--resume", "--seed", 1, "--out", tmp_path)
    assert experiments == ["toy", "game", "toy", "game", "toy", "game"]


def test_an_experiment_that_fails_does_not_keep_the_others_from_running(experiments, monkeypatch, tmp_path):
    from sigmapoint.experiments import EXPERIMENTS

    def broken(*_):
        raise ImportError("the toy needs <springs>")

    whole = EXPERIMENTS["toy"].run
    monkeypatch.setattr(EXPERIMENTS["toy"], "run", broken)
    assert "toy failed, see above; --resume" in message("reproduce", "--all", "--jobs", 1, "--out", tmp_path, code=1)
    index = (tmp_path / "index.html").read_text()
    assert "<td>toy</td><td>failed: ImportError: the toy needs &lt;springs&gt;</td>" in index
    assert "0 of 2 claims reproduced" in index
    monkeypatch.setattr(EXPERIMENTS["toy"], "run", whole)
    invoke("reproduce", "--all", "--jobs", 1, "--resume", "--out", tmp_path)
    assert experiments == ["game", "toy"]
    assert "1 of 2 claims reproduced" in (tmp_path / "index.html").read_text()


def test_reproduce_hands_a_folder_of_data_to_those_that_take_one(experiments, tmp_path):
    assert "two files" in invoke("reproduce", "--list").stdout
    invoke("reproduce", "--all", "--jobs", 1, "--data", tmp_path, "--out", tmp_path / "out")
    given = {name: (tmp_path / "out" / name / "data.txt").read_text() for name in ("toy", "game")}
    assert given == {"toy": "", "game": str(tmp_path)}
    assert "toy takes no folder of data; experiments that do: game" in message("reproduce", "toy", "--data", tmp_path)
    absent = message("reproduce", "game", "--data", tmp_path / "absent")
    assert "absent is not a folder; game wants two files" in absent


def test_reproduce_names_the_experiments_where_none_or_another_is_given(experiments):
    assert "experiments: toy, game" in message("reproduce")
    assert "give toy or --all, not both" in message("reproduce", "toy", "--all")
    assert "Did you mean toy?" in message("reproduce", "tog")
    assert message("reproduce", "toy", "--runs", 0)


def test_the_tank_of_the_documentation_runs_and_finds_its_leak(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "tutorials" / "commandline.md").read_text("utf-8")
    model, log = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    Path("tank.py").write_text(model)
    exec(compile(f"{model}\n{log}", "page", "exec"), {"__name__": "page"})
    invoke("run", "tank.py", "tank.csv", "--method", "srukf", "--smooth", "--out", "out")
    assert {path.name for path in Path("out").iterdir()} == FILES
    last, true = pd.read_parquet("out/estimates.parquet").iloc[-1], pd.read_csv("tank.csv").iloc[-1]
    assert abs(last["leak"] - true["true leak [1/s]"]) < 3 * last["leak std"]
    assert last["leak std"] < 0.05 * 0.01  # of what it was at first
