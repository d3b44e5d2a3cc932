"""A linear model of one state, its exact answer, and a particle filter of every make."""

from typing import Any

import jax.numpy as jnp
import pytest

import sigmapoint as sp

MODEL = sp.StateSpaceModel(
    lambda x, u: 0.9 * x,
    lambda x, u: x,
    0.5 * jnp.eye(1),
    0.25 * jnp.eye(1),
    sp.Gaussian(jnp.ones(1), jnp.eye(1)),
)
Y = jnp.array([[1.5], [jnp.nan], [0.4], [-1.0], [-0.2], [1.1]])
EXACT = sp.filter(MODEL, Y)


def some(names, slow):
    """Parameters of a test, some of them for `-m slow` only."""
    return [pytest.param(name, marks=pytest.mark.slow) if name in slow else name for name in names]


def sums(N: int) -> dict[str, Any]:
    """Gaussian sums, which are consistent, but not unbiased."""
    return {"gspf": sp.gspf(N, 4), "gmsppf": sp.gmsppf(N, 3)}


def makes(N: int) -> dict[str, Any]:
    """Every kind of proposal, selection and move."""
    guided = sp.proposals.guided(sp.srcdkf())
    return {
        "bootstrap": sp.bootstrap(N),
        "prior, its own noise": sp.particle_filter(N, proposal=sp.proposals.prior(process_noise=jnp.eye(1))),
        "ekpf": sp.ekpf(N),
        "upf": sp.upf(N),
        "carried, its own noise": sp.particle_filter(
            N, proposal=sp.proposals.carried(sp.cdkf(), process_noise=jnp.eye(1), observation_noise=0.5 * jnp.eye(1))
        ),
        "guided": sp.particle_filter(N, proposal=guided),
        "auxiliary": sp.auxiliary(sp.bootstrap(N)),
        "auxiliary upf": sp.auxiliary(sp.upf(N)),
        "fully adapted": sp.auxiliary(sp.particle_filter(N, proposal=guided, threshold=1.0)),
        "Rao-Blackwellised": sp.rao_blackwellised(N, (0,)),
        "moved": sp.particle_filter(N, threshold=1.0, move=sp.moves.random_walk()),
        "moved upf": sp.particle_filter(
            N, proposal=sp.proposals.carried(sp.srukf()), threshold=1.0, move=sp.moves.independence()
        ),
    }
