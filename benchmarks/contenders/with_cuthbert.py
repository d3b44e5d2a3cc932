# /// script
# requires-python = ">=3.11"
# dependencies = ["cuthbert==0.1.1", "cuthbertlib==0.1.1", "jax==0.10.2", "numpy==2.4.6"]
# ///
"""cuthbert: `gaussian.moments`, its square-root extended Kalman filter, linearized at the latest mean.

Every step of cuthbert predicts first, so the first one gets degenerate dynamics, as its documentation says.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from cuthbert import filter as run_filter
from cuthbert.gaussian.moments import build_filter
from cuthbert.inference import Filter

sys.path.insert(0, str(Path(__file__).parents[1]))
from problems import problem
from worker import serve

jax.config.update("jax_enable_x64", True)


def _filters(name: str) -> tuple[Filter, Filter]:
    """That of the first measurement, without dynamics, and that of all the others."""
    one = problem(name, jnp)
    mean, still = jnp.asarray(one.mean, float), jnp.zeros(one.Q.shape)
    chol_P, chol_Q, chol_R = (jnp.asarray(np.linalg.cholesky(a)) for a in (one.cov, one.Q, one.R))

    def observe(state: Any, y: Any) -> Any:
        return lambda x: (one.h(x), chol_R), state.mean, y

    def stay(state: Any, y: Any) -> Any:
        return lambda x: (x, still), state.mean

    def move(state: Any, y: Any) -> Any:
        return lambda x: (one.f(x), chol_Q), state.mean

    return build_filter(mean, chol_P, stay, observe), build_filter(mean, chol_P, move, observe)


def _step(method: Filter, state: Any, y: Any) -> Any:
    return method.filter_combine(state, method.filter_prepare(y))


def _make(many: bool) -> Any:
    def make(name: str, y: np.ndarray) -> Callable[[], Any]:
        (first, rest), y = _filters(name), jnp.asarray(y)

        def one(y: Any) -> Any:
            start = _step(first, first.init_prepare(), y[0])
            return run_filter(rest, y[1:], start).mean

        compiled = jax.jit(jax.vmap(one) if many else one)
        return lambda: jax.block_until_ready(compiled(y))

    return make


def _online(name: str, y: np.ndarray) -> Callable[[], Any]:
    first, rest = _filters(name)
    update = jax.jit(lambda y: _step(first, first.init_prepare(), y))
    step = jax.jit(lambda state, y: _step(rest, state, y))

    def run() -> tuple[np.ndarray, np.ndarray]:
        state, means, seconds = None, [], []
        for row in y:
            begin = time.perf_counter()
            state = step(state, row) if means else update(row)
            means.append(np.asarray(state.mean))
            seconds.append(time.perf_counter() - begin)
        return np.array(means), np.array(seconds)

    return run


if __name__ == "__main__":
    serve(filter={"srekf": _make(many=False)}, batch={"srekf": _make(many=True)}, online={"srekf": _online})
