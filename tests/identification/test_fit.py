"""Maximum likelihood and its error bars against the textbook filter, closed forms and counts over many series."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.kalman import kalman_filter

import sigmapoint as sp
from sigmapoint.identification import search
from sigmapoint.identification.profile import Profile

TRUTH = {"a": 0.9, "q": 1.0, "r": 2.0}
THETA = {"a": sp.bounded(0.5, 0.2, low=-1.0, high=1.0), "q": sp.positive(0.3, 0.3), "r": sp.positive(1.0, 1.0)}
METHOD = sp.srekf()
T = 100


def autoregression(theta):
    one = jnp.eye(1, dtype=jnp.asarray(theta["q"]).dtype)
    start = sp.Gaussian(jnp.zeros_like(one[0]), one)
    return sp.StateSpaceModel(lambda x, u: theta["a"] * x, lambda x, u: x, theta["q"] * one, theta["r"] * one, start)


MODEL = autoregression(TRUTH)


def measured(seed):
    return sp.simulate(MODEL, T, key=jax.random.key(seed))[1]


def textbook(density, y):
    """The log-likelihood as a function of z, by the Kalman filter of the textbook."""

    def of(z):
        theta = {name: float(value) for name, value in density.theta(jnp.asarray(z)).items()}
        F, Q, H, R = (np.full((len(y), 1, 1), value) for value in (theta["a"], theta["q"], 1.0, theta["r"]))
        zero = np.zeros((len(y), 1))
        return kalman_filter(F, zero, Q, H, zero, R, np.zeros(1), np.eye(1), np.asarray(y)).log_likelihood

    return of


def differences(f, z, h=2e-3):
    """Gradient and Hessian by central differences of fourth and second order."""
    steps = h * np.eye(len(z))
    gradient = np.array([(8 * (f(z + e) - f(z - e)) - f(z + 2 * e) + f(z - 2 * e)) / (12 * h) for e in steps])
    hessian = [[f(z + a + b) - f(z + a - b) - f(z - a + b) + f(z - a - b) for a in steps] for b in steps]
    return gradient, np.array(hessian) / (4 * h**2)


@pytest.fixture(scope="module")
def found():
    return sp.fit(autoregression, THETA, measured(0), method=METHOD)


def test_the_optimum_and_its_errors_are_those_of_the_textbook_likelihood(found):
    y, z = measured(0), np.asarray(found.z)
    f = textbook(found.posterior, y)
    gradient, hessian = differences(f, z)
    assert found.converged
    assert found.log_likelihood == pytest.approx(f(z), rel=1e-10)
    # What a Newton step on the textbook's likelihood would change [prior deviations]; differences are good to 1e-9.
    assert np.abs(np.linalg.solve(hessian, gradient)).max() < 1e-6
    np.testing.assert_allclose(found.z_cov, np.linalg.inv(-hessian), rtol=1e-3)  # h² of the second differences


def test_the_model_is_the_one_at_the_optimum_and_print_is_a_table(found):
    assert sp.filter(found.model, measured(0), method=METHOD).log_likelihood == pytest.approx(found.log_likelihood)
    lines = str(found).splitlines()
    assert [line.split()[0] for line in lines] == ["value", "a", "q", "r", "log-likelihood"]
    assert f"{float(found.estimates.value['a']):.4g}" in lines[1]
    assert "converged" in lines[-1]


def test_what_was_not_measured_does_not_count():
    y = measured(1).at[30:60].set(jnp.nan)
    found = sp.fit(autoregression, THETA, y, method=METHOD)
    assert found.converged
    assert np.abs(differences(textbook(found.posterior, y), np.asarray(found.z))[0]).max() < 1e-6


def test_95_percent_intervals_hold_the_truth_that_often():
    """Of 3 parameters and 24 series."""
    within = []
    for seed in range(100, 124):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # in a short series r may be at zero, which is said
            estimates = sp.fit(autoregression, THETA, measured(seed), method=METHOD).estimates
        known = [name for name in TRUTH if np.isfinite(estimates.std[name])]
        within += [estimates.low[name] < TRUTH[name] < estimates.high[name] for name in known]
    # Three sigma of a binomial about 95 %, where the 24 series count as the independent ones.
    assert len(within) >= 60
    assert abs(np.mean(within) - 0.95) < 3 * np.sqrt(0.95 * 0.05 / 24)


def test_single_precision_finds_the_same_within_a_small_part_of_the_error_bars(found):
    single = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), THETA)
    same = sp.fit(autoregression, single, measured(0).astype(jnp.float32), method=METHOD)
    assert same.z.dtype == jnp.float32
    std = np.sqrt(np.diagonal(found.z_cov))
    assert (np.abs(np.asarray(same.z) - np.asarray(found.z)) / std).max() < 0.02
    np.testing.assert_allclose(np.sqrt(np.diagonal(same.z_cov)), std, rtol=0.02)


def offset(theta):
    """Measurements of a constant with a deviation of 0.5."""
    still = sp.Gaussian(jnp.zeros(1), jnp.zeros((1, 1)))
    return sp.StateSpaceModel(lambda x, u: x, lambda x, u: x + theta["b"], jnp.zeros((1, 1)), 0.25 * jnp.eye(1), still)


OFFSETS = 2.0 + 0.5 * np.random.default_rng(0).normal(size=(20, 1))


@pytest.mark.parametrize("prior", [0.0, 1.0])
def test_a_prior_counts_as_the_conjugate_formula_says(prior):
    found = sp.fit(offset, {"b": sp.real(-1.0, 0.2)}, OFFSETS, method=METHOD, prior=prior)
    precision = prior / 0.2**2 + 20 / 0.25
    mean = (prior * -1.0 / 0.2**2 + OFFSETS.sum() / 0.25) / precision
    assert found.theta["b"] == pytest.approx(mean, rel=1e-9)
    assert found.estimates.std["b"] == pytest.approx(precision**-0.5, rel=1e-9)
    low, high = found.profile("b").interval  # of a parabola: two deviations
    np.testing.assert_allclose([low, high], [mean - 2 * precision**-0.5, mean + 2 * precision**-0.5], rtol=1e-6)


def test_a_gaussian_theta_is_found_in_its_own_units():
    theta = sp.Gaussian(jnp.array([-1.0]), jnp.array([[0.04]]))
    found = sp.fit(lambda b: offset({"b": b[0]}), theta, OFFSETS, method=METHOD)
    assert found.theta[0] == pytest.approx(OFFSETS.mean(), rel=1e-9)
    assert found.estimates.std[0] == pytest.approx(0.5 / 20**0.5, rel=1e-9)


def test_a_search_that_ends_too_early_says_so(monkeypatch):
    monkeypatch.setattr(search, "POLISHES", 1)
    with pytest.warns(UserWarning, match=r"not converged after \d steps, about .* give steps more than 2"):
        found = sp.fit(offset, {"b": sp.real(-1.0, 0.001)}, OFFSETS[:19], method=METHOD, steps=2)
    assert not found.converged
    assert "NOT CONVERGED" in str(found)


def scales(theta):
    """Two constants of different size with noises of theirs; and the sum of two more."""
    still = sp.Gaussian(jnp.zeros(1), jnp.zeros((1, 1)))

    def observation(x, u):
        return jnp.stack([1e9 * theta["small"], 1e-6 * theta["large"], theta["one"] + theta["other"]])

    return sp.StateSpaceModel(lambda x, u: x, observation, jnp.zeros((1, 1)), 0.01 * jnp.eye(3), still)


def test_sizes_do_not_matter_and_what_cannot_be_told_apart_has_no_error_bar():
    y = np.array([3.0, -2.0, 1.0]) + 0.1 * np.random.default_rng(1).normal(size=(30, 3))
    theta = {"small": 1e-9, "large": 1e6, "one": 1.0, "other": 1.0}
    with pytest.warns(UserWarning, match="leave one, other open, alone or together"):
        found = sp.fit(scales, theta, y, method=METHOD)
    assert found.converged
    value, std = found.estimates.value, found.estimates.std
    assert value["small"] == pytest.approx(1e-9 * y[:, 0].mean(), rel=1e-8)
    assert value["large"] == pytest.approx(1e6 * y[:, 1].mean(), rel=1e-8)
    assert value["one"] + value["other"] == pytest.approx(y[:, 2].mean(), rel=1e-8)
    assert std["small"] == pytest.approx(1e-9 * 0.1 / 30**0.5, rel=1e-8)
    assert np.isnan(std["one"])
    assert np.isnan(std["other"])
    assert "open" in str(found)


def test_bfgs_finds_the_end_of_a_curved_valley():
    def valley(s):
        return 100 * (s[1] - s[0] ** 2) ** 2 + (1 - s[0]) ** 2

    found = jax.jit(lambda s: search.minimum(valley, s, 1.0, 200))(jnp.array([-1.2, 1.0]))
    np.testing.assert_allclose(found.s, 1.0, atol=1e-10)
    assert int(found.steps) < 100


def _level(q):
    """A state whose process noise is `q`, which may be no variance."""
    return sp.StateSpaceModel(
        lambda x, u: 0.9 * x, lambda x, u: x, q * jnp.eye(1), 0.1 * jnp.eye(1), sp.Gaussian(jnp.ones(1), jnp.eye(1))
    )


def test_a_variance_is_not_fitted_below_zero():
    y = sp.simulate(_level(1e-9), 60, key=0)[1]
    density = sp.log_posterior(_level, sp.real(0.05, 0.1), y)
    below = jnp.array([-1.0])
    assert density(below) == -jnp.inf
    assert jax.grad(density)(below) == 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the optimum may be at the bound
        assert sp.fit(_level, sp.real(0.05, 0.1), y, method=sp.ekf()).theta >= 0


def test_under_a_transformation_the_way_out_is_named():
    fit = jax.jit(lambda y: sp.fit(autoregression, THETA, y).z)
    with pytest.raises(ValueError, match=r"fit is not for use under jax.jit.*sp.log_posterior"):
        fit(np.ones((3, 1)))


def test_a_profile_begins_at_its_own_peak_and_says_so():
    value = np.linspace(-2.0, 2.0, 9)
    two = Profile("a", value, -2 * np.minimum((value + 1) ** 2 + 0.1, (value - 1) ** 2 / 0.1), -0.2)
    low, high = two.interval
    assert low < 1 < high
