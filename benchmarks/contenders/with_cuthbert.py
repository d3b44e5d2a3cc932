# /// script
# requires-python = ">=3.11"
# dependencies = ["cuthbert==0.1.1", "cuthbertlib==0.1.1", "jax==0.10.2", "numpy==2.4.6"]
# ///
"""cuthbert: its particle filter, and `gaussian.moments`, its square-root extended Kalman filter.

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
from cuthbert.smc import particle_filter
from cuthbertlib.resampling import systematic
from cuthbertlib.resampling.adaptive import ess_decorator

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


def _particles(count: int) -> Any:
    """Its particle filter, with the mean of each step; the first measurement weighs the draws of the prior."""

    def make(name: str, y: np.ndarray) -> Callable[[], Any]:
        one, y = problem(name, jnp), jnp.asarray(y)
        mean, P, Q, W = (jnp.asarray(a, float) for a in (one.mean, *map(np.linalg.cholesky, (one.cov, one.Q)), one.R))
        W = jnp.linalg.inv(jnp.linalg.cholesky(W))

        def start(key: Any) -> Any:
            return mean + P @ jax.random.normal(key, mean.shape)

        def move(key: Any, x: Any, y: Any) -> Any:
            return one.f(x) + Q @ jax.random.normal(key, mean.shape)

        def weigh(before: Any, x: Any, y: Any) -> Any:
            white = W @ (y - one.h(x))
            return -0.5 * white @ white + jnp.log(jnp.diagonal(W)).sum() - 0.9189385332046727 * white.shape[0]

        method = particle_filter.build_filter(start, move, weigh, count, ess_decorator(systematic.resampling, 0.5))

        def average(state: Any) -> Any:
            return jax.nn.softmax(state.log_weights) @ state.particles

        def run(y: Any) -> Any:
            keys = jax.random.split(jax.random.key(0), y.shape[0])
            first = method.init_prepare(key=keys[0])
            weights = jax.vmap(weigh, (None, 0, None))(None, first.particles, y[0])
            first = first._replace(log_weights=weights, model_inputs=y[0])

            def step(state: Any, given: Any) -> Any:
                state = method.filter_combine(state, method.filter_prepare(given[1], key=given[0]))
                return state, average(state)

            return jnp.concatenate([average(first)[None], jax.lax.scan(step, first, (keys[1:], y[1:]))[1]])

        compiled = jax.jit(run)
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
    serve(
        filter={"srekf": _make(many=False), **{f"bootstrap-{N}": _particles(N) for N in (1_000, 10_000)}},
        batch={"srekf": _make(many=True)},
        online={"srekf": _online},
    )
