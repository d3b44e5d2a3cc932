"""What has no counterpart elsewhere: gradient beside filter, new processes, memory, the second core, ragged series.

    uv run python benchmarks/own.py [--repetitions 7] [--out out/benchmarks]

The turn of `problems.py` throughout. Writes own.json into the folder `--out`, and prints it.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from alone import alone, written
from problems import problem, turn_measurements

import sigmapoint as sp

jax.config.update("jax_enable_x64", True)
METHODS = {"ukf": sp.ukf(), "srukf": sp.srukf(), "srcdkf": sp.srcdkf(), "srekf": sp.srekf()}
KEEP = ("mean", "std")


def model(noise: Any = 1.0) -> sp.StateSpaceModel:
    """The turn, its process noise times `noise`."""
    one = problem("turn", jnp)
    start = sp.Gaussian(one.mean, one.cov)
    return sp.StateSpaceModel(lambda x, u: one.f(x), lambda x, u: one.h(x), one.Q * noise, one.R, start)


def alternating(repetitions: int, **runs: Callable[[], Any]) -> dict[str, float]:
    """Median seconds of each, the repetitions in turn, after one that compiles."""
    times: dict[str, list[float]] = {name: [] for name in runs}
    for k in range(repetitions + 1):
        for name, run in runs.items():
            begin = time.perf_counter()
            jax.block_until_ready(run())
            if k:
                times[name].append(time.perf_counter() - begin)
    return {name: float(np.median(each)) for name, each in times.items()}


def gradients(repetitions: int) -> dict[str, float]:
    """Value and gradient of the log-likelihood over the filter alone, 100,000 rows, one parameter."""
    y, found = jnp.asarray(turn_measurements(100_000)), {}
    for name, method in METHODS.items():

        def likelihood(noise: Any, method: sp.Method = method) -> Any:
            return sp.filter(model(noise), y, method=method, keep=()).log_likelihood

        value, gradient = jax.jit(likelihood), jax.jit(jax.value_and_grad(likelihood))
        took = alternating(repetitions, filter=lambda f=value: f(1.0), gradient=lambda f=gradient: f(1.0))
        found[name] = took["gradient"] / took["filter"]
    return found


def ragged(repetitions: int) -> dict[str, float]:
    """Microseconds a row of 1,000 series of 100 to 1,000 rows, and of as many of one length: the same rows in all."""
    y = turn_measurements(1_000)
    lengths = np.random.default_rng(0).integers(100, 1_001, 1_000)
    rows = int(lengths.sum())
    even = [y[: round(rows / 1_000)]] * 1_000
    uneven = [y[:length] for length in lengths]
    both = {"one length": even, "ragged": uneven, "in one array": jnp.asarray(np.stack(even))}
    turn = model()
    runs = {name: lambda ys=ys: sp.batch(turn, ys, method=sp.ukf(), keep=KEEP) for name, ys in both.items()}
    return {name: seconds / rows * 1e6 for name, seconds in alternating(repetitions, **runs).items()}


def batch() -> float:
    """In a process of its own: 10,000 series of 200 rows on the cores it may use."""
    y = jnp.asarray(np.stack([turn_measurements(200, seed) for seed in range(100)] * 100))
    turn = model()
    took = alternating(7, batch=lambda: sp.batch(turn, y, method=sp.ukf(), keep=KEEP))
    return took["batch"] / y.shape[0] / y.shape[1] * 1e6


def first() -> float:
    """In a process of its own: one result, from the import on."""
    post = sp.filter(model(), turn_measurements(1_000), method=sp.ukf())
    return float(post.log_likelihood)


def memory() -> float:
    """In a process of its own: peak memory of a million rows, in MB."""
    post = sp.filter(model(), turn_measurements(1_000_000), method=sp.ukf(), keep=KEEP)
    jax.block_until_ready(post.std)
    # (`getrusage` would count what the process that started this one had.)
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))


def process(name: str, cores: int = 0, **environment: str) -> tuple[float, float]:
    """What the function of this name gives in a new process on so many cores (0: all), and the seconds it took."""
    begin = time.perf_counter()
    found = alone(__file__, name, "--cores", str(cores), env=os.environ | environment)
    return found, time.perf_counter() - begin


def main() -> None:
    """Measure, write, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=7)
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--alone", help=argparse.SUPPRESS)
    parser.add_argument("--cores", type=int, default=0, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.alone:
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: chosen.cores or None])
        print({"batch": batch, "first": first, "memory": memory}[chosen.alone]())
        return
    each = range(chosen.repetitions)
    with tempfile.TemporaryDirectory() as cache:
        kept = {"JAX_COMPILATION_CACHE_DIR": cache, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.1"}
        process("first", **kept)
        new = [(process("first")[1], process("first", **kept)[1]) for _ in each]
    cold, cached = np.median(new, axis=0)
    one, two = np.median([(process("batch", 1)[0], process("batch", 2)[0]) for _ in range(3)], axis=0)
    found = {
        "gradient over filter": gradients(chosen.repetitions),
        "us a row, 1,000 series": ragged(chosen.repetitions),
        "new process to first result, s": {"cold": cold, "with the cache": cached},
        "peak memory of 10^6 rows, MB": process("memory")[0],
        "us a row, 10,000 series": {"one core": one, "two cores": two, "gain": one / two},
    }
    written(found, chosen.out, "own.json")


if __name__ == "__main__":
    main()
