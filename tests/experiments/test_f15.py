"""The F-15: that a quick run sees half of a stabilator go, within its bars."""

import json

import numpy as np
import pytest

from sigmapoint.experiments import EXPERIMENTS
from sigmapoint.experiments.f15 import experiment as f15
from sigmapoint.experiments.f15 import times as f15_times

pytest.importorskip("jsbsim")


def test_half_of_a_stabilator_is_missed_within_seconds(tmp_path):
    rows = EXPERIMENTS["f15"].run(None, 0, tmp_path, True)
    assert json.loads((tmp_path / "results.json").read_text()) == rows
    assert all((tmp_path / f"{figure}.png").exists() for figure in ("f15-path", "f15-mission", "f15-factors"))
    measured = {row["quantity"]: row["measured"] for row in rows if row["method"] == f15.SHOWN}
    before, after, in_time, reached, *_ = (measured[quantity] for quantity in f15.LEARNED)
    assert abs(before - 1) < 0.05
    assert abs(after - 0.5) < 0.05
    assert in_time == 1
    assert reached < 5
    assert min(measured[f"share of the time within 2σ, {state}"] for state in f15.BARS) > f15.WANTED_INSIDE


def test_times_are_compared_in_pairs():
    known = f15_times.Times(np.array([4.0, 9.0, 6.0]), np.array([2.0, 3.0, 5.0]))
    assert known.median == 2
    assert known.shortest == 2
