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


if __name__ == "__main__":
    serve(filter={"ukf": _make(many=False)}, batch={"ukf": _make(many=True)})
