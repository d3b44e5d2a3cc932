"""Filter and smoother of an affine model (n = 5, m = 2): parallel in time beside one instant after the other.

    uv run python benchmarks/parallel.py [--lengths 1000,10000,100000]

For every length T: the largest difference in standard deviations, microseconds per instant of both, combinations per
instant of each of the two passes, and how many of them have to follow each other (the depth of a pass).
"""

import argparse
import json
import sys
import time
from pathlib import Path
from types import ModuleType

import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from laws import affine_case

from sigmapoint import affine, parallel

jax.config.update("jax_enable_x64", True)


def measured(form: ModuleType, model: affine.Affine) -> tuple[affine.SquareRoot, dict[str, float]]:
    """The smoothed beliefs, and time for one instant."""
    T = model.c.shape[0]
    compiled = jax.jit(lambda model: form.smoothed(model, form.filtered(model))).lower(model).compile()
    times = []
    for _ in range(4):
        begin = time.perf_counter()
        beliefs = jax.block_until_ready(compiled(model))
        times.append(time.perf_counter() - begin)
    return beliefs, {"us_per_instant": float(np.median(times[1:])) / T * 1e6}


def main() -> None:
    """Measure, and print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lengths", default="1000,10000,100000")
    found = {}
    for T in map(int, parser.parse_args().lengths.split(",")):
        model = affine_case.case(T, 5, 2)
        one, in_parallel = measured(parallel, model)
        other, in_sequence = measured(affine, model)
        std = jnp.sqrt(jnp.sum(other.factor**2, -1))
        blocks = -(-T // parallel.BLOCK)
        doublings = (blocks - 1).bit_length()
        combinations = 2 * T - blocks + blocks * doublings
        found[T] = {
            "largest difference": float(jnp.max(jnp.abs(one.mean - other.mean) / std)),
            "parallel": {
                **in_parallel,
                "combinations_per_instant": combinations / T,
                "depth": parallel.BLOCK + doublings,
            },
            "sequential": {**in_sequence, "depth": T},
        }
    print(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
