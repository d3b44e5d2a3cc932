"""Results with innovations as they are wanted, and what a diagnosis said of them."""

import jax.numpy as jnp
import numpy as np

from sigmapoint.diagnosis.consistency import normalised
from sigmapoint.results import Labels, Posterior

T, M = 4000, 2
LABELS = Labels(("a", "b"), ("m", "1"), ("p", "q"), ("V", ""))
S = np.array([[2.0, 0.6], [0.6, 0.5]])


def made(innovation, scale=1.0, u=None, cov=S):
    """A result with these innovations, of a filter that thinks their covariance is `cov`."""
    innovation = np.asarray(innovation) * scale
    n = len(innovation)
    full = np.broadcast_to(cov, (n, *cov.shape))
    nis = normalised(innovation, full).squared
    eye = jnp.broadcast_to(jnp.eye(2), (n, 2, 2))
    return Posterior(
        mean=jnp.zeros((n, 2)),
        cov=eye,
        std=jnp.ones((n, 2)),
        innovation=jnp.asarray(innovation),
        innovation_cov=jnp.asarray(full),
        nis=jnp.asarray(nis),
        log_likelihood=jnp.asarray(0.0),
        y=jnp.asarray(innovation),
        u=u,
        labels=LABELS,
    )


def said(found, word):
    return [v for v in found.verdicts if word in v.text]
