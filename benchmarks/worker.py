"""One library in an environment of its own, kept warm: tasks on standard input, results on standard output.

A contender is a file that says what it can do and calls `serve`:

    serve(filter={"ukf": make}, batch={"ukf": make}, online={"ukf": make})

* `filter`: `make(problem_name, y)` with y (T, m) prepares everything and gives `run()`, which runs the filter once over
  y and returns its filtered means (T, n), when they are there and not only asked for;
* `batch`: the same with y (B, T, m) and means (B, T, n);
* `online`: `run()` takes in the rows of y one at a time, as they would arrive live, and returns the filtered means
  (T, n) and the seconds that each row took (T,).

Where a run times itself, it returns its seconds after the means. Every request is a line of JSON: `{"task": "filter",
"method": "ukf", "problem": "turn", "data": "y.npy"}`; the answer is one too: `seconds` of this run, or of each row
`median_us` and `p99_us`; and where it is the first of its kind `first_s`, with preparation and compilation, and
`means`, a file with the means.
"""

import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Make = Callable[[str, np.ndarray], Callable[[], Any]]


def serve(**tasks: dict[str, Make]) -> None:
    """Answer requests until standard input ends."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what a library prints must not come between
    print(json.dumps({task: sorted(methods) for task, methods in tasks.items()}), file=answers, flush=True)
    ready: dict[str, Callable[[], Any]] = {}
    for line in sys.stdin:
        request = json.loads(line)
        try:
            answer = _answer(tasks, ready, line, request)
        except Exception as error:  # one case that fails must not end the others
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), file=answers, flush=True)


def _answer(tasks: dict[str, dict[str, Make]], ready: dict[str, Callable[[], Any]], line: str, request: Any) -> Any:
    answer: dict[str, Any] = {}
    if line not in ready:
        begin = time.perf_counter()
        ready[line] = tasks[request["task"]][request["method"]](request["problem"], np.load(request["data"]))
        result = ready[line]()
        answer["first_s"] = time.perf_counter() - begin
        means = result[0] if isinstance(result, tuple) else result
        with tempfile.NamedTemporaryFile(suffix=".npy", dir=Path(request["data"]).parent, delete=False) as file:
            np.save(file, np.asarray(means))
        answer["means"] = file.name
    begin = time.perf_counter()
    result = ready[line]()
    answer["seconds"] = time.perf_counter() - begin
    if isinstance(result, tuple):
        own = np.asarray(result[1])
        answer["seconds"] = float(own.sum())
        if request["task"] == "online":
            answer["median_us"], answer["p99_us"] = (float(q) * 1e6 for q in np.quantile(own, [0.5, 0.99]))
    return answer
