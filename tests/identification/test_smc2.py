"""Posterior and evidence by SMC² against sums over a grid; what is refused and what is warned of."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from identification.level import THETA, Y, build, exact

import sigmapoint as sp
from sigmapoint.filtering import fitting
from sigmapoint.identification import population
from sigmapoint.identification.likelihood import posterior_of
from sigmapoint.identification.population import advanced, drawn

RUNS, SAMPLES = 5, 150
STATES, GAUSSIAN = sp.bootstrap(50), sp.srekf()


@pytest.mark.parametrize("method", [STATES, GAUSSIAN], ids=["particles", "gaussian"])
def test_posterior_and_evidence_are_those_of_the_grid(method):
    runs = [sp.smc2(build, THETA, Y, key=seed, method=method, samples=SAMPLES) for seed in range(RUNS)]
    truth, z = exact(Y), np.concatenate([run.z.ravel() for run in runs])
    independent = RUNS * SAMPLES / 4  # copies, and moves of which a third is accepted
    assert abs(z.mean() - truth.mean) < 4 * truth.std / np.sqrt(independent)
    assert abs(z.std() / truth.std - 1) < 4 / np.sqrt(2 * independent)
    # Unbiased for the evidence itself; its logarithm has a deviation of 0.2 at most in these runs.
    evidence = np.exp([run.log_evidence - truth.log_evidence for run in runs])
    assert abs(evidence.mean() - 1) < 4 * 0.2 / np.sqrt(RUNS)
    assert evidence.std() < 0.4
    assert runs[0].samples["a"].shape == (1, SAMPLES)
    assert np.isnan(runs[0].r_hat).all()


def test_the_better_of_two_models_has_the_higher_evidence_by_what_the_grid_says():
    alternating = {"a": sp.bounded(-0.5, 0.3, low=-1.0, high=1.0)}
    right, wrong = (sp.smc2(build, theta, Y, key=1, method=GAUSSIAN, samples=SAMPLES) for theta in (THETA, alternating))
    expected = exact(Y).log_evidence - exact(Y, alternating).log_evidence
    assert expected > 1
    # Four deviations of a difference of two.
    assert right.log_evidence - wrong.log_evidence == pytest.approx(expected, abs=1.1)


def test_rows_taken_in_one_by_one_are_the_same_run(monkeypatch):
    monkeypatch.setattr(population, "HALF", 0.0)
    posterior = posterior_of(build, THETA, [Y, Y[:13]], None, sp.bootstrap(20), fitting)
    keys = jax.random.split(jax.random.key(0), 5)
    z = posterior.prior_draws(jax.random.key(1), 5)
    found = advanced(posterior, drawn(posterior, z, keys))
    together = jax.jit(jax.vmap(posterior.log_likelihood))(z, keys)
    np.testing.assert_allclose(found.points.log_likelihood, together, rtol=1e-12)
    np.testing.assert_allclose(found.log_evidence, jax.nn.logsumexp(together) - np.log(5), rtol=1e-12)


def test_a_row_that_nothing_explains_is_named():
    with pytest.raises(ValueError, match="smc2: none of 150 draws of theta explains row 7 of y"):
        sp.smc2(build, THETA, Y.at[7].set(1e200), key=0, method=STATES, samples=SAMPLES)


def test_too_few_particles_of_the_state_are_warned_of():
    with pytest.warns(UserWarning, match="of the last moves were accepted, so that few of the samples differ"):
        sp.smc2(build, THETA, 20 * Y, key=0, method=STATES, samples=SAMPLES)


@pytest.mark.slow
def test_a_prior_without_a_model_is_named():
    def elsewhere(theta):
        R = jnp.where(theta == 1.0, 1.0, -1.0) * jnp.eye(1)
        start = sp.Gaussian(jnp.zeros(1), jnp.eye(1))
        return sp.StateSpaceModel(lambda x, u: x, lambda x, u: x, jnp.eye(1), R, start)

    with pytest.raises(ValueError, match="none of 20 draws of theta makes a model"):
        sp.smc2(elsewhere, sp.real(1.0, 0.1), Y, key=0, method=GAUSSIAN, samples=20)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"y": Y + np.nan}, "y has no measurements"),
        ({"key": jnp.zeros(2)}, "key must be jax.random.key"),
        ({"samples": 1}, "samples must be a whole number of at least 2"),
        ({"steps": 0}, "steps must be a whole number of at least 1"),
    ],
)
def test_wrong_input_is_named(more, said):
    given = {"y": Y, "key": 0, **more}
    with pytest.raises(ValueError, match=said):
        sp.smc2(build, THETA, given.pop("y"), **given)
