"""Time a step of Lorenz-96, every second state measured, against the number of states: dense and square root.

    uv run python benchmarks/lorenz.py [--states 2,3,4,6,8,12,16,24,40,80] [--repetitions 7]

Prints one JSON object: microseconds a step (median of the repetitions), and seconds of the first call with compilation.
"""

import argparse
import json
import time

import jax
import jax.numpy as jnp
import numpy as np

import sigmapoint as sp

jax.config.update("jax_enable_x64", True)
METHODS = {"ukf": sp.ukf, "srukf": sp.srukf}


def problem(n: int) -> sp.StateSpaceModel:
    """Lorenz-96 with forcing 8, one Euler step of 0.01."""

    def dynamics(x, u):
        return x + 0.01 * ((jnp.roll(x, -1) - jnp.roll(x, 2)) * jnp.roll(x, 1) - x + 8)

    m = max(n // 2, 1)
    start = sp.Gaussian(np.full(n, 8.0), np.eye(n))
    return sp.StateSpaceModel(dynamics, lambda x, u: x[::2][:m], 0.01 * np.eye(n), 0.1 * np.eye(m), start)


def main() -> None:
    """Measure, and print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--states", default="2,3,4,6,8,12,16,24,40,80")
    parser.add_argument("--repetitions", type=int, default=7)
    chosen = parser.parse_args()
    found = {}
    for n in map(int, chosen.states.split(",")):
        T = 20_000 if n <= 16 else 2_000
        model = problem(n)
        y = sp.simulate(model, T, key=jax.random.key(0))[1]
        row: dict[str, dict[str, float]] = {}
        for name, make in METHODS.items():
            times = []
            for _ in range(chosen.repetitions + 1):
                begin = time.perf_counter()
                post = sp.filter(model, y, method=make(), keep=("mean", "std"))
                times.append(time.perf_counter() - begin)
            if not bool(jnp.isfinite(post.log_likelihood)):
                raise SystemExit(f"{name} has lost the {n} states")
            row[name] = {"us_per_step": float(np.median(times[1:])) / T * 1e6, "first_call_s": times[0]}
        found[n] = row
    print(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
