# /// script
# requires-python = ">=3.11"
# dependencies = ["smcx==2.1.0", "jax==0.10.2", "numpy==2.4.6"]
# ///
"""smcx."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import smcx

sys.path.insert(0, str(Path(__file__).parents[1]))
from problems import problem
from worker import serve

jax.config.update("jax_enable_x64", True)


def _make(many: bool) -> Any:
    def make(name: str, y: np.ndarray) -> Callable[[], Any]:
        model, y = problem(name, jnp), jnp.asarray(y)
        mean, cov, Q, R = (jnp.asarray(a, float) for a in (model.mean, model.cov, model.Q, model.R))

        def one(y: Any) -> Any:
            return smcx.unscented_kalman_filter(
                mean, cov, model.f, Q, model.h, R, y, alpha=1.0, beta=2.0, kappa=0.0
            ).filtered_means

        compiled = jax.jit(jax.vmap(one) if many else one)
        return lambda: jax.block_until_ready(compiled(y))

    return make


def _particles(count: int) -> Any:
    """Its bootstrap filter step by step, with the mean of each: in one call it keeps all particles of all steps."""

    def make(name: str, y: np.ndarray) -> Callable[[], Any]:
        model, y = problem(name, jnp), jnp.asarray(y)
        mean, P, Q = (jnp.asarray(a, float) for a in (model.mean, np.linalg.cholesky(model.cov), _root(model.Q)))
        W = jnp.asarray(np.linalg.inv(_root(model.R)))
        size = mean.shape[0]

        def start(key: Any, N: int) -> Any:
            return mean + jax.random.normal(key, (N, size)) @ P.T

        def move(key: Any, x: Any) -> Any:
            return model.f(x) + Q @ jax.random.normal(key, (size,))

        def weigh(y: Any, x: Any) -> Any:
            white = W @ (y - model.h(x))
            return -0.5 * white @ white + jnp.log(jnp.diagonal(W)).sum() - 0.9189385332046727 * white.shape[0]

        def average(checkpoint: Any) -> Any:
            return jnp.exp(checkpoint.state.log_weights) @ checkpoint.state.particles

        def run(y: Any) -> Any:
            keys = jax.random.split(jax.random.key(0), y.shape[0])
            first, _ = smcx.bootstrap_init(keys[0], start, weigh, y[0], count)

            def step(state: Any, given: Any) -> Any:
                state, _ = smcx.bootstrap_step(given[0], state, move, weigh, given[1])
                return state, average(state)

            return jnp.concatenate([average(first)[None], jax.lax.scan(step, first, (keys[1:], y[1:]))[1]])

        compiled = jax.jit(run)
        return lambda: jax.block_until_ready(compiled(y))

    return make


def _root(cov: np.ndarray) -> np.ndarray:
    return np.linalg.cholesky(cov)


if __name__ == "__main__":
    serve(
        filter={"ukf": _make(many=False), **{f"bootstrap-{N}": _particles(N) for N in (1_000, 10_000)}},
        batch={"ukf": _make(many=True)},
    )
