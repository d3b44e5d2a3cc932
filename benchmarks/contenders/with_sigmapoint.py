"""sigmapoint."""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from problems import problem
from worker import serve

import sigmapoint as sp

jax.config.update("jax_enable_x64", True)
KEEP = ("mean", "std")


def _model(name: str) -> sp.StateSpaceModel:
    one = problem(name, jnp)
    start = sp.Gaussian(one.mean, one.cov)
    return sp.StateSpaceModel(lambda x, u: one.f(x), lambda x, u: one.h(x), one.Q, one.R, start)


def _make(run: Callable[..., Any], method: sp.Method) -> Any:
    def make(name: str, y: np.ndarray) -> Callable[[], Any]:
        model, y = _model(name), jnp.asarray(y)
        return lambda: jax.block_until_ready(run(model, y, method=method, keep=KEEP).mean)

    return make


def _online(method: sp.Method) -> Any:
    def make(name: str, y: np.ndarray) -> Callable[[], Any]:
        live = sp.online(_model(name), method)
        start = live.prepare(y[0])

        def run() -> tuple[np.ndarray, np.ndarray]:
            ahead, means, seconds = start, [], []
            for row in y:
                begin = time.perf_counter()
                state, _, ahead = live.step(ahead, row)
                means.append(np.asarray(state.mean))
                seconds.append(time.perf_counter() - begin)
            return np.array(means), np.array(seconds)

        return run

    return make


def _particles(method: sp.ParticleMethod) -> Any:
    def make(name: str, y: np.ndarray) -> Callable[[], Any]:
        model, y, key = _model(name), jnp.asarray(y), jax.random.key(0)
        return lambda: jax.block_until_ready(sp.filter(model, y, method=method, key=key, keep=("mean",)).mean)

    return make


METHODS = {"ukf": sp.ukf(), "srukf": sp.srukf(), "srcdkf": sp.srcdkf(), "cdkf": sp.cdkf(), "srekf": sp.srekf()}

if __name__ == "__main__":
    serve(
        filter={
            **{name: _make(sp.filter, method) for name, method in METHODS.items()},
            **{f"bootstrap-{N}": _particles(sp.bootstrap(N)) for N in (1_000, 10_000)},
            "upf-200": _particles(sp.upf(200)),
        },
        batch={name: _make(sp.batch, method) for name, method in METHODS.items()},
        online={name: _online(method) for name, method in METHODS.items()},
    )
