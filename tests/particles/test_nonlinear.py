"""Where a belief has two modes, every particle filter finds the exact answer of a grid; no Gaussian filter does."""

import numpy as np
import pytest
from particles.nonlinear_case import EXACT, MODEL, U, Y
from particles.scalar_case import some

import sigmapoint as sp

N = 40_000
FEWER = 10_000
METHODS = {
    "bootstrap": sp.bootstrap(N),
    "upf": sp.upf(FEWER),
    "guided": sp.particle_filter(FEWER, proposal=sp.proposals.guided(sp.srcdkf())),
    "auxiliary": sp.auxiliary(sp.bootstrap(N)),
    "Rao-Blackwellised": sp.rao_blackwellised(FEWER, (0,)),
    "gspf": sp.gspf(FEWER, 20),
    "gmsppf": sp.gmsppf(FEWER, 10, iterations=20),
}


@pytest.mark.parametrize("name", some(METHODS, ["upf", "guided", "auxiliary"]))
def test_particle_filters_find_the_exact_answer(name):
    post = sp.filter(MODEL, Y[:, None], U, METHODS[name], key=0)
    # The effective sample size is a thousand where it is least, 0.03 of a standard deviation, and the weight of a mode
    # once lost is lost for the rest; the likelihood, a product of eight such, is known to 0.05.
    assert (np.abs(np.asarray(post.mean[:, 0]) - EXACT.mean) < 0.12 * EXACT.std).all()
    np.testing.assert_allclose(post.std[:, 0], EXACT.std, rtol=0.08)
    # A few Gaussians are not the density: beyond the draws, Gaussian sums are off by what they leave out.
    np.testing.assert_allclose(post.log_likelihood, EXACT.log_likelihood, atol=0.3 if "sp" in name else 0.15)


@pytest.mark.parametrize("method", [sp.ekf(), sp.srukf(), sp.srcdkf(), sp.ghkf(7)], ids=str)
def test_no_gaussian_filter_does(method):
    post = sp.filter(MODEL, Y[:, None], U, method)
    assert np.abs(np.asarray(post.log_likelihood) - EXACT.log_likelihood) > 0.5
