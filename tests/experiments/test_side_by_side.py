"""Experiments in processes of their own: what they leave, and what they raise."""

import json
import multiprocessing
import os
from functools import partial

import pytest

from sigmapoint.experiments.publishing.campaign import Settings, finished
from sigmapoint.experiments.publishing.side_by_side import THREADS, Task, few_threads, side_by_side


def test_each_is_conducted_in_a_process_of_its_own_and_what_it_raises_arrives(tmp_path, monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    good = Task("rosenbrock", Settings(None, 0, True, None), tmp_path / "good")
    bad = Task("rosenbrock", Settings(1, 0, True, None), tmp_path / "bad")
    note = partial(os.system, f"echo $OMP_NUM_THREADS >> {tmp_path}/threads")
    found = dict(side_by_side([good, bad], 2, note))
    assert found[good]() == json.loads((tmp_path / "good" / "results.json").read_text())
    assert finished(good.settings, good.out)
    with pytest.raises(ValueError, match="runs must be at least 2"):
        found[bad]()
    assert set((tmp_path / "threads").read_text().split()) == {str(max(1, (os.cpu_count() or 1) // 2))}


def test_processes_of_linear_algebra_share_the_cores(monkeypatch):
    for name in THREADS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    with few_threads(4), multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.map(os.getenv, ["OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"]) == ["2", "3"]
    assert THREADS & os.environ.keys() == {"OMP_NUM_THREADS"}
