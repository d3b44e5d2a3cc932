"""What learning costs: beside filterpy, beside scaling the matrix, beside our EKF; memory; ten thousand weights.

    uv run python benchmarks/learning.py [--repetitions 7] [--out out/benchmarks]

Networks 2-H-2 on the robot arm, 5 H + 2 weights. Writes learning.json into the folder `--out`, and prints it.
(Exponents against L: `sigmapoint reproduce cost`.)
"""

import argparse
import json
import os
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from alone import alone, written
from jax.flatten_util import ravel_pytree
from own import alternating

import sigmapoint as sp
from sigmapoint.problems import network, robot_arm

jax.config.update("jax_enable_x64", True)
METHODS = {"srukf": sp.srukf(), "srcdkf": sp.srcdkf(), "srekf": sp.srekf()}
FILTERPY = Path(__file__).parent / "contenders" / "learning_filterpy.py"


def problem(units: int, rows: int, dtype: Any = float) -> tuple[Any, Any, Any]:
    """Weights to start with, angles, places."""
    w = network.started((2, units, 2), jax.random.key(0))
    return jax.tree.map(lambda a: jnp.asarray(a, dtype), (w, *robot_arm.drawn(rows, jax.random.key(1))))


def learned(method: sp.Method, w: Any, x: Any, d: Any, devices: Any = None) -> sp.Trained:
    """One epoch."""
    noise = robot_arm.NOISE**2
    return sp.learn(network.network, w, x, d, noise=noise, prior_std=0.1, method=method, devices=devices)


def beside_filterpy(repetitions: int, units: int = 100) -> dict[str, Any]:
    """Milliseconds an update, in turn; the difference of the weights after the same pairs."""
    w, x, d = problem(units, 5)
    times: dict[str, list[float]] = {"filterpy": [], "ours": []}
    many = problem(units, 500)
    fit = learned(sp.srukf(), w, x, d)
    learned(sp.srukf(), *many)
    theirs: Any = {}
    with tempfile.NamedTemporaryFile(suffix=".npz") as file:
        np.savez(file, w=ravel_pytree(w)[0], x=x, d=d, prior=0.1**2, noise=robot_arm.NOISE**2)
        file.flush()
        command = ["uv", "run", "--quiet", "--script", str(FILTERPY), file.name, str(units)]
        for _ in range(repetitions):
            theirs = json.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout)
            times["filterpy"].append(float(np.median(theirs["seconds"])))
            begin = time.perf_counter()
            jax.block_until_ready(learned(sp.srukf(), *many).state)
            times["ours"].append((time.perf_counter() - begin) / len(many[1]))
    took = {name: float(np.median(each)) * 1e3 for name, each in times.items()}
    apart = float(np.abs(np.array(theirs["mean"]) - fit.state.mean).max() / np.abs(fit.state.mean).max())
    return {"weights": 5 * units + 2, "ms": took, "ratio": took["filterpy"] / took["ours"], "difference": apart}


def beside_scaling(repetitions: int, units: int = 800, rows: int = 4) -> dict[str, Any]:
    """Milliseconds an update, and to scale the matrix once."""
    w, x, d = problem(units, rows)
    P = jnp.eye(5 * units + 2)
    scale = jax.jit(lambda P: P * 1.0001)
    runs = {name: lambda m=method: learned(m, w, x, d).state for name, method in METHODS.items()}
    took = alternating(repetitions, scaling=lambda: scale(P), **runs)
    ms = {name: each * 1e3 / (1 if name == "scaling" else rows) for name, each in took.items()}
    return {"weights": len(P), "ms": ms, "ratios": {name: ms[name] / ms["scaling"] for name in METHODS}}


def beside_ekf(repetitions: int) -> dict[str, Any]:
    """Microseconds an update on the robot arm itself, in one epoch of 5,000 pairs."""
    w, x, d = problem(12, 5_000)
    took = alternating(repetitions, **{name: lambda m=m: learned(m, w, x, d).state for name, m in METHODS.items()})
    us = {name: each / len(x) * 1e6 for name, each in took.items()}
    return {"weights": 62, "us": us, "srukf over srekf": us["srukf"] / us["srekf"]}


def memory(units: int) -> float:
    """In a process of its own: peak memory of training that many units, beyond that before, in matrices of the factor's
    size."""
    w, x, d = problem(8, 4)
    jax.block_until_ready(learned(sp.srukf(), w, x, d).state)
    w, x, d = problem(units, 4)
    before = _resident("VmRSS")
    jax.block_until_ready(learned(sp.srukf(), w, x, d).state)
    return (_resident("VmHWM") - before) / (8 * (5 * units + 2) ** 2)


def _resident(field: str) -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(field))


def ten_thousand(updates: int) -> dict[str, Any]:
    """In a process of its own: a 2-2002-2 network, 10,012 weights, in 32 bits, on all devices."""
    w, x, d = problem(2_002, updates, jnp.float32)
    begin = time.perf_counter()
    fit = learned(sp.srcdkf(), w, x, d, jax.devices())
    jax.block_until_ready(fit.state)
    seconds = time.perf_counter() - begin
    return {
        "weights": fit.state.mean.shape[0],
        "updates": int(fit.state.step),
        "seconds an update": seconds / updates,
        "finite": bool(jnp.isfinite(fit.state.uncertainty.columns).all()),
        "mean": fit.state.mean.tolist(),
    }


def on_devices(updates: int) -> dict[str, Any]:
    """That on one device and on four, and how far their weights are apart."""
    four = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=4"
    found = {
        name: alone(__file__, "ten_thousand", str(updates), env=os.environ | environment)
        for name, environment in (("one device", {}), ("four devices", {"XLA_FLAGS": four}))
    }
    one, several = (np.array(each.pop("mean")) for each in found.values())
    return {**found, "difference of the weights": float(np.abs(one - several).max() / np.abs(one).max())}


def main() -> None:
    """Measure, write, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=7)
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--alone", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.alone:
        print(json.dumps({"memory": memory, "ten_thousand": ten_thousand}[given.alone[0]](int(given.alone[1]))))
        return
    environment = dict(os.environ)
    found = {
        "beside filterpy": beside_filterpy(given.repetitions),
        "beside scaling the matrix": beside_scaling(given.repetitions),
        "beside the EKF": beside_ekf(given.repetitions),
        "peak memory over 8 L², L = 4002": alone(__file__, "memory", "800", env=environment),
        "ten thousand weights": on_devices(20),
    }
    written(found, given.out, "learning.json")


if __name__ == "__main__":
    main()
