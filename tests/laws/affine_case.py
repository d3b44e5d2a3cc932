"""Random stable affine models with missing measurements."""

import jax.numpy as jnp
import numpy as np

from sigmapoint import affine


def case(T: int, n: int, m: int) -> affine.Affine:
    """T instants, n states, m measurements, a tenth of them missing."""
    r = np.random.default_rng(0)
    F = r.normal(size=(T, n, n))
    F *= 0.98 / np.linalg.norm(F, 2, axis=(1, 2))[:, None, None]
    F[0] = 0
    W, V = np.tril(r.normal(size=(T, n, n))), np.tril(r.normal(size=(T, m, m)))
    rows = (F, r.normal(size=(T, n)), W, r.normal(size=(T, m, n)), 3 * r.normal(size=(T, m)), V)
    active = r.uniform(size=(T, m)) < 0.9
    return affine.Affine(*map(jnp.asarray, rows), jnp.asarray(active))
