# /// script
# requires-python = ">=3.11"
# dependencies = ["particles==0.4", "numpy==1.26.4"]
# ///
"""particles: its bootstrap filter, over functions of all particles at once."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import particles
from particles.collectors import Moments

sys.path.insert(0, str(Path(__file__).parents[1]))
from problems import problem
from worker import serve


class _Bootstrap(particles.FeynmanKac):
    """Of a problem whose functions take the elements of the state apart: (d, N) and back."""

    def __init__(self, name: str, y: np.ndarray):
        super().__init__(len(y))
        self.one, self.y, self.r = problem(name), y, np.random.default_rng(0)
        self.P, self.Q = np.linalg.cholesky(self.one.cov), np.linalg.cholesky(self.one.Q)
        self.W = np.linalg.inv(np.linalg.cholesky(self.one.R))
        self.constant = np.log(np.diag(self.W)).sum() - len(self.W) * np.log(2 * np.pi) / 2

    def M0(self, N: int) -> np.ndarray:
        return self.one.mean + self.r.normal(size=(N, len(self.P))) @ self.P.T

    def M(self, t: int, xp: np.ndarray) -> np.ndarray:
        return self.one.f(xp.T).T + self.r.normal(size=xp.shape) @ self.Q.T

    def logG(self, t: int, xp: np.ndarray, x: np.ndarray) -> np.ndarray:
        white = (self.y[t] - self.one.h(x.T).T) @ self.W.T
        return self.constant - 0.5 * np.einsum("ni,ni->n", white, white)


def _particles(count: int) -> Any:
    def make(name: str, y: np.ndarray) -> Callable[[], Any]:
        def run() -> np.ndarray:
            collect = [Moments(mom_func=lambda W, x: W @ x)]
            filtered = particles.SMC(fk=_Bootstrap(name, y), N=count, resampling="systematic", collect=collect)
            filtered.run()
            return np.array(filtered.summaries.moments)

        return run

    return make


if __name__ == "__main__":
    serve(filter={f"bootstrap-{N}": _particles(N) for N in (1_000, 10_000)})
