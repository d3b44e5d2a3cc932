# /// script
# requires-python = ">=3.11"
# dependencies = ["dynamax==1.0.3", "jax==0.10.2", "tfp-nightly==0.26.0.dev20261027", "numpy==2.4.6"]
# ///
"""dynamax. Its `psd_solve` adds 1e-9 to the diagonal of the innovation covariance, so the means differ a little."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from dynamax.nonlinear_gaussian_ssm import (
    ParamsNLGSSM,
    UKFHyperParams,
    extended_kalman_filter,
    unscented_kalman_filter,
)

sys.path.insert(0, str(Path(__file__).parents[1]))
from problems import problem
from worker import serve

jax.config.update("jax_enable_x64", True)
KEEP = ["filtered_means"]


def _ukf(params: ParamsNLGSSM, y: Any) -> Any:
    points = UKFHyperParams(alpha=1.0, beta=2, kappa=0)
    return unscented_kalman_filter(params, y, points, output_fields=KEEP).filtered_means


def _ekf(params: ParamsNLGSSM, y: Any) -> Any:
    return extended_kalman_filter(params, y, output_fields=KEEP).filtered_means


def _params(name: str) -> ParamsNLGSSM:
    one = problem(name, jnp)
    mean, cov, Q, R = (jnp.asarray(a, float) for a in (one.mean, one.cov, one.Q, one.R))
    return ParamsNLGSSM(mean, cov, one.f, Q, one.h, R)


def _make(method: Callable[[ParamsNLGSSM, Any], Any], many: bool) -> Any:
    def make(name: str, y: np.ndarray) -> Callable[[], Any]:
        params, y = _params(name), jnp.asarray(y)

        def one(y: Any) -> Any:
            return method(params, y)

        compiled = jax.jit(jax.vmap(one) if many else one)
        return lambda: jax.block_until_ready(compiled(y))

    return make


METHODS = {"ukf": _ukf, "ekf": _ekf}

if __name__ == "__main__":
    serve(
        filter={name: _make(method, many=False) for name, method in METHODS.items()},
        batch={"ukf": _make(_ukf, many=True)},
    )
