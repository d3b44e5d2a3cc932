"""Other JAX programs of one's own, with sigmapoint's loop setting and without: do they suffer?

    uv run python benchmarks/neighbours.py [--repetitions 5] [--out out/benchmarks]

Every repetition is a pair of new processes. Prints, for each program, the median time with the setting over that
without, and writes neighbours.json into the folder `--out`.
"""

import argparse
import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from alone import alone, written

import sigmapoint as sp

KEY = jax.random.key(0)
assert sp  # its import adds the setting


def normal(*shape: int) -> Any:
    """Random numbers of this shape, the same each time."""
    return jax.random.normal(KEY, shape)


def repeated(step: Callable[[Any], Any], start: Any, times: int) -> Callable[[], Any]:
    """`start`, `step(start)`, …, in a compiled loop."""
    compiled = jax.jit(lambda x: jax.lax.fori_loop(0, times, lambda _, x: step(x), x))
    return lambda: compiled(start)


def trained(width: int, batch: int) -> Callable[[], Any]:
    """A network of two hidden layers under gradient descent."""
    weights = [normal(8, width) / 3, normal(width, width) / width**0.5, normal(width, 1) / width**0.5]
    x = normal(batch, 8)

    def loss(w: Any) -> Any:
        return jnp.mean((jnp.tanh(jnp.tanh(x @ w[0]) @ w[1]) @ w[2] - jnp.sin(x.sum(1, keepdims=True))) ** 2)

    return repeated(lambda w: [a - 0.1 * b for a, b in zip(w, jax.grad(loss)(w))], weights, 300)


def recurrent(width: int, batch: int) -> Callable[[], Any]:
    """A recurrent network over 200 instants."""
    W, xs = normal(width, width) / width**0.5, normal(200, batch, width)
    compiled = jax.jit(lambda W: jax.lax.scan(lambda h, x: (jnp.tanh(h @ W + x), h.sum()), xs[0], xs))
    return lambda: compiled(W)


def lorenz(x: Any) -> Any:
    """An explicit step of a differential equation."""
    return x + 1e-3 * jnp.stack([10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]])


def programs() -> dict[str, Callable[[], Any]]:
    """What people run, by name."""
    kernel, image = normal(8, 8, 3, 3) / 9, normal(4, 8, 32, 32)
    return {
        "network 16 wide, batch 32": trained(16, 32),
        "network 64 wide, batch 64": trained(64, 64),
        "recurrent 32 wide, batch 16": recurrent(32, 16),
        "recurrent 128 wide, batch 32": recurrent(128, 32),
        **{
            f"matrix product {n}": repeated(lambda A: A @ A / jnp.abs(A).max(), normal(n, n), 200)
            for n in (10, 64, 200)
        },
        "linear solve 50": repeated(
            lambda b: jnp.linalg.solve(3 * jnp.eye(50) + normal(50, 50) / 7, b), jnp.ones(50), 100
        ),
        "differential equation": repeated(lorenz, jnp.ones(3), 50_000),
        "sine of 1,000": repeated(jnp.sin, jnp.ones(1_000), 500),
        "sine of 100,000": repeated(jnp.sin, jnp.ones(100_000), 500),
        "convolution 32 x 32": repeated(lambda x: jnp.tanh(jax.lax.conv(x, kernel, (1, 1), "SAME")), image, 50),
    }


def measured() -> dict[str, float]:
    """Median seconds of seven runs of each, warm."""
    found = {}
    for name, run in programs().items():
        times = []
        for _ in range(8):
            begin = time.perf_counter()
            jax.block_until_ready(run())
            times.append(time.perf_counter() - begin)
        found[name] = float(np.median(times[1:]))
    return found


def main() -> None:
    """Measure in pairs, write, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--alone", action="store_true", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.alone:
        print(json.dumps(measured()))
        return

    settings = [os.environ | {"SIGMAPOINT_NATIVE": native} for native in ("1", "0")]
    pairs = [[alone(__file__, env=env) for env in settings] for _ in range(chosen.repetitions)]
    ratios = {name: float(np.median([on[name] / off[name] for on, off in pairs])) for name in pairs[0][0]}
    written(ratios, chosen.out, "neighbours.json")


if __name__ == "__main__":
    main()
