"""What samples say of parameters in their own units, without a run that draws them."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import norm

import sigmapoint as sp
from sigmapoint.filtering import fitting
from sigmapoint.identification.estimates import Estimates
from sigmapoint.identification.likelihood import posterior_of

THETA = {"a": sp.bounded(0.5, 0.2, low=0.0, high=1.0), "q": sp.positive([0.5, 2.0], 0.2), "note": "no number"}
M = 4000


def build(theta):
    start = sp.Gaussian(jnp.zeros(2), jnp.eye(2))
    return sp.StateSpaceModel(lambda x, u: theta["a"] * x, lambda x, u: x, jnp.diag(theta["q"]), jnp.eye(2), start)


def samples(r_hat=1.0, log_evidence=float("nan")):
    """Of the prior: every quantile of it, in an order of its own for each parameter."""
    r = np.random.default_rng(0)
    z = np.stack([r.permutation(norm.ppf((np.arange(M) + 0.5) / M)) for _ in range(3)], axis=1).reshape(2, M // 2, 3)
    posterior = posterior_of(build, THETA, np.zeros((5, 2)), None, sp.ekf(), fitting)
    ones = np.ones(3)
    return sp.PosteriorSamples(
        posterior, jnp.asarray(z), jnp.zeros((2, M // 2)), 0.25, 300 * ones, r_hat * ones, log_evidence
    )


def test_samples_are_like_the_parameters_with_axes_for_chains_and_draws():
    found = samples()
    assert found.samples["note"] == "no number"
    assert found.samples["a"].shape == (2, M // 2)
    assert found.samples["q"].shape == (2, M // 2, 2)
    theta = found.posterior.theta(found.z[1, 7])
    assert found.samples["a"][1, 7] == theta["a"]
    assert (found.samples["q"][1, 7] == theta["q"]).all()


def test_estimates_are_quantiles():
    found = samples()
    expected = Estimates.of(found.posterior.unknowns, jnp.zeros(3), jnp.ones(3))
    for name in ("value", "std", "low", "high"):
        for part in ("a", "q"):  # quantiles of 4000 points, between two of which z jumps by 0.005 at most
            np.testing.assert_allclose(getattr(found.estimates, name)[part], getattr(expected, name)[part], rtol=0.01)
    assert found.model.process_noise.cov[1, 1] == found.theta["q"][1]


def test_print_is_a_table():
    lines = str(samples(log_evidence=-12.5)).splitlines()
    assert [line.split()[0] for line in lines] == ["median", "a", "q[0]", "q[1]", "2"]
    assert lines[1].split()[-2:] == ["300", "1.000"]
    assert lines[-1] == "2 × 2000 samples, 25% accepted, log-evidence -12.5"
    assert "evidence" not in str(samples())


@pytest.mark.parametrize(("r_hat", "verdicts"), [(1.0, 0), (np.nan, 0), (1.2, 1)])
def test_a_page_says_where_chains_do_not_agree(r_hat, verdicts, tmp_path):
    found = samples(r_hat)
    (section,) = found.contents().sections
    assert len(section.verdicts) == verdicts
    assert [row["parameter"] for row in section.tables[""]] == ["a", "q[0]", "q[1]"]
    sp.report({"parameters": found}, tmp_path / "page.html")
    assert ("The chains do not agree" in (tmp_path / "page.html").read_text()) == bool(verdicts)
