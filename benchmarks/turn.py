"""Time a step of a coordinated turn with range and bearing (n = 5, m = 2) beside the same filter in C++ with Eigen.

    uv run python benchmarks/turn.py [--rows 100000] [--repetitions 9]

needs g++ and Eigen (Debian: libeigen3-dev). The target circles near the origin, so that its bearing does not wrap. Both
programs give the same log-likelihood first; then their repetitions alternate, and medians are compared.
"""

import argparse
import json
import subprocess
import tempfile
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import sigmapoint as sp

jax.config.update("jax_enable_x64", True)
SOURCE = Path(__file__).parent / "eigen" / "ukf.cpp"


def dynamics(x, u):
    """Constant speed and turn rate for one second."""
    w = x[4]
    s, c = jnp.sin(w), jnp.cos(w)
    return jnp.stack(
        [
            x[0] + s / w * x[1] - (1 - c) / w * x[3],
            c * x[1] - s * x[3],
            x[2] + (1 - c) / w * x[1] + s / w * x[3],
            s * x[1] + c * x[3],
            w,
        ]
    )


def observation(x, u):
    """Range and bearing from the origin."""
    return jnp.stack([jnp.hypot(x[0], x[2]), jnp.arctan2(x[2], x[0])])


def problem() -> sp.StateSpaceModel:
    """The model, as in `eigen/ukf.cpp`."""
    move = 0.1 * np.array([[1 / 3, 1 / 2], [1 / 2, 1]])
    Q = np.zeros((5, 5))
    Q[:2, :2] = Q[2:4, 2:4] = move
    Q[4, 4] = 1e-6
    start = sp.Gaussian(np.array([1000, 30, 1000, 0, 0.05]), np.diag([100, 10, 100, 10, 1e-4]))
    return sp.StateSpaceModel(dynamics, observation, Q, np.diag([100, 1e-5]), start)


def measurements(rows: int) -> np.ndarray:
    """Noisy range and bearing of a target on a circle of 600 m about (1000, 1600) m, 0.05 rad/s."""
    t = np.arange(rows)
    east, north = 1000 + 600 * np.sin(0.05 * t), 1600 - 600 * np.cos(0.05 * t)
    noise = np.random.default_rng(0).normal(size=(rows, 2)) * [10, 1e-5**0.5]
    return np.column_stack([np.hypot(east, north), np.arctan2(north, east)]) + noise


def compiled(folder: Path) -> Path:
    """The C++ program, compiled for this machine."""
    program = folder / "ukf"
    flags = ["-O3", "-march=native", "-I/usr/include/eigen3"]
    subprocess.run(["g++", *flags, str(SOURCE), "-o", str(program)], check=True)
    return program


def main() -> None:
    """Check, measure, print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=100_000)
    parser.add_argument("--repetitions", type=int, default=9)
    chosen = parser.parse_args()
    model, y = problem(), measurements(chosen.rows)
    names = {"ukf": sp.ukf(), "srukf": sp.srukf(), "cdkf": sp.cdkf(), "srcdkf": sp.srcdkf(), "srekf": sp.srekf()}
    series = jnp.asarray(y)

    def run(name: str) -> tuple[float, float]:
        begin = time.perf_counter()
        post = jax.block_until_ready(sp.filter(model, series, method=names[name], keep=("mean", "std")))
        return time.perf_counter() - begin, float(post.log_likelihood)

    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "y.bin"
        y.tofile(data)
        program = compiled(Path(folder))

        def eigen() -> tuple[float, float]:
            shown = subprocess.run([program, data, str(chosen.rows), "1"], capture_output=True, text=True, check=True)
            seconds, log_likelihood, *_ = map(float, shown.stdout.split())
            return seconds, log_likelihood

        first = {name: run(name) for name in names}
        reference = eigen()[1]
        if abs(first["ukf"][1] - reference) > 1e-6 * abs(reference):
            raise SystemExit(f"the programs differ: {first['ukf'][1]} and {reference}")
        times: dict[str, list[float]] = {name: [] for name in ("eigen", *names)}
        for _ in range(chosen.repetitions):
            times["eigen"].append(eigen()[0])
            for name in names:
                times[name].append(run(name)[0])
    median = {name: float(np.median(each)) / chosen.rows * 1e6 for name, each in times.items()}
    found = {
        "rows": chosen.rows,
        "repetitions": chosen.repetitions,
        "us_per_step": median,
        "ratio_to_eigen": {name: median[name] / median["eigen"] for name in names},
        "first_call_s": {name: first[name][0] for name in names},
    }
    print(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
