"""Moves part copies and leave the posterior as it is."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from particles.scalar_case import MODEL, some

import sigmapoint as sp

N, RUNS = 2000, 40


def drift(key, x):
    """A step that prefers one direction: not symmetric."""
    there = 0.8 * x + 0.3 + 0.5 * jax.random.normal(key, x.shape)
    back = jnp.sum((x - 0.8 * there - 0.3) ** 2 - (there - 0.8 * x - 0.3) ** 2) / (2 * 0.25)
    return there, -back


MOVES = {
    "random walk": sp.moves.random_walk(0.7, steps=5),
    "independence": sp.moves.independence(5),
    "a kernel of one's own": sp.moves.metropolis(drift, steps=5),
}

PROPOSALS = {"prior": sp.proposals.prior(), "upf": sp.proposals.carried(sp.srukf())}


@pytest.mark.parametrize("proposal", some(PROPOSALS, ["upf"]))
@pytest.mark.parametrize("name", MOVES)
def test_a_move_leaves_the_posterior_as_it_is_and_parts_copies(name, proposal):
    proposal = PROPOSALS[proposal]
    y = jnp.array([[0.2], [2.5]])
    method = sp.particle_filter(N, proposal=proposal, threshold=1.0, move=MOVES[name])
    still = sp.particle_filter(N, proposal=proposal, threshold=1.0)
    exact = sp.filter(MODEL, y)
    keys = jax.random.split(jax.random.key(0), RUNS)
    keep = ("mean", "cov", "particles")
    post = jax.vmap(lambda key: sp.filter(MODEL, y, method=method, key=key, keep=keep))(keys)
    for found, true in ((post.mean, exact.mean), (post.cov[..., 0], exact.cov[..., 0])):
        off = np.asarray(found).mean(0) - np.asarray(true)
        # The covariance of a sample of N is off by a share of 1/N.
        assert (np.abs(off) < 4 * np.asarray(found).std(0) / np.sqrt(RUNS) + 2 / N).all()
    # Fresh draws of the prior are refused to a third of the copies: few lie near an outlier.
    assert len(np.unique(post.particles[0, 1])) > 0.6 * N
    copied = sp.online(MODEL, still)
    state = copied.update(copied.predict(copied.update(copied.init(key=0), y[0])[0]), y[1])[0]
    assert len(np.unique(copied.predict(state).origin.centre)) < 0.95 * N
    assert len(np.unique(post.particles[0, 1])) > len(np.unique(copied.predict(state).origin.centre))
