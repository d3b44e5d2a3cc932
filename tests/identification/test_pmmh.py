"""Particle marginal Metropolis–Hastings against the exact posterior; what is refused and what is warned of."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from identification.level import THETA, Y, build, exact

import sigmapoint as sp
from sigmapoint.identification import chains
from sigmapoint.identification.chains import diagnosed

PARTICLES, GAUSSIAN = sp.bootstrap(60), sp.srekf()


@pytest.mark.parametrize("method", [PARTICLES, GAUSSIAN], ids=["particles", "gaussian"])
def test_mean_and_deviation_are_those_of_the_exact_posterior(method):
    found = sp.pmmh(build, THETA, Y, key=0, method=method, warmup=300, samples=700)
    truth, z = exact(Y), np.asarray(found.z)
    square = (z - truth.mean) ** 2
    # Four Monte Carlo standard errors, from the effective sample size of each.
    assert abs(z.mean() - truth.mean) < 4 * truth.std / np.sqrt(found.ess[0])
    assert abs(square.mean() - truth.std**2) < 4 * square.std() / np.sqrt(diagnosed(square)[0][0])
    assert found.ess[0] > 150  # so that the above says something
    assert found.r_hat[0] < 1.05
    assert 0.1 < found.acceptance_rate < 0.5


def test_too_few_particles_are_warned_of():
    with (
        pytest.warns(UserWarning, match="chains do not agree on a "),
        pytest.warns(UserWarning, match=r"has a variance of \d.*beyond 3 they hardly move: give the method more part"),
    ):
        found = sp.pmmh(build, THETA, 20 * Y, key=0, method=PARTICLES, warmup=50, samples=50)
    assert not found.agree


def interrupted(monkeypatch, call):
    """Ctrl-C in one of the calls."""
    calls, walked = [], chains.walked

    def now(*args):
        calls.append(0)
        if len(calls) == call:
            raise KeyboardInterrupt
        return walked(*args)

    monkeypatch.setattr(chains, "walked", now)


def test_what_was_sampled_before_ctrl_c_is_returned(monkeypatch):
    interrupted(monkeypatch, call=4)
    with pytest.warns(UserWarning, match="interrupted; the first 80 of 10000 samples are returned"):
        found = sp.pmmh(build, THETA, Y, key=0, method=GAUSSIAN, warmup=70, samples=10_000)
    assert found.z.shape == (4, 80, 1)
    interrupted(monkeypatch, call=1)
    with pytest.raises(KeyboardInterrupt):
        sp.pmmh(build, THETA, Y, key=0, method=GAUSSIAN, warmup=70, samples=10_000)


def test_a_prior_without_a_likelihood_is_named():
    with pytest.raises(ValueError, match="pmmh: the log-likelihood is not finite at any of 64 draws of theta"):
        sp.pmmh(build, THETA, Y.at[7].set(1e200), key=0, method=PARTICLES)


@pytest.mark.slow
def test_single_precision_stays():
    def single(theta):
        one = jnp.eye(1, dtype=jnp.float32)
        start = sp.Gaussian(jnp.zeros(1, jnp.float32), one)
        return sp.StateSpaceModel(lambda x, u: theta["a"] * x, lambda x, u: x, 0.5 * one, 0.3 * one, start)

    theta = jax.tree.map(lambda a: a.astype(jnp.float32), THETA)
    found = sp.pmmh(single, theta, Y.astype(jnp.float32), key=0, method=PARTICLES, warmup=300, samples=700)
    assert found.z.dtype == found.log_likelihood.dtype == jnp.float32
    assert np.isfinite(found.z).all()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"theta": {}}, "theta has no unknown parameters"),
        ({"y": Y[:, 0]}, r"y must be \(T, m\)"),
        ({"y": Y + np.nan}, "y has no measurements"),
        ({"u": np.zeros(3)}, "u must have one row for each of the 20 rows of y"),
        ({"key": jnp.zeros(2)}, "key must be jax.random.key"),
        ({"samples": 3}, "samples must be a whole number of at least 4"),
        ({"warmup": -1}, "warmup must be a whole number of at least 0"),
        ({"chains": 0}, "chains must be a whole number of at least 1"),
        ({"build": lambda theta: theta}, r"build\(theta\) must be a sp.StateSpaceModel"),
    ],
)
def test_wrong_input_is_named(more, said):
    given = {"build": build, "theta": THETA, "y": Y, "u": None, "key": 0, **more}
    first = [given.pop(name) for name in ("build", "theta", "y", "u")]
    with pytest.raises(ValueError, match=said):
        sp.pmmh(*first, **given)


def test_under_a_transformation_the_way_out_is_named():
    with pytest.raises(ValueError, match=r"pmmh is not for use under jax.jit.*sp.log_posterior"):
        jax.jit(lambda y: sp.pmmh(build, THETA, y, key=0).z)(Y)
