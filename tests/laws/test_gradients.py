"""The derivative of the log-likelihood is that of finite differences, also where a covariance is zero."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sigmapoint as sp

METHODS = {
    "ekf": sp.ekf(),
    "srekf": sp.srekf(),
    "ukf": sp.ukf(),
    "srukf": sp.srukf(),
    "cdkf": sp.cdkf(),
    "srcdkf": sp.srcdkf(),
    "augmented": sp.augmented(sp.srcdkf()),
    "iterated": sp.iterated(sp.srukf(), 2),
}
T = 25
Y = np.random.default_rng(3).normal(size=(T, 2)) * 0.3
Y[4, 0] = Y[9] = np.nan


def _likelihood(method, theta):
    """A damped pendulum seen through its sine and its rate; every covariance from `theta`."""
    model = sp.StateSpaceModel(
        lambda x, u: jnp.stack([x[0] + 0.1 * x[1], x[1] - 0.1 * (theta["g"] * jnp.sin(x[0]) + 0.2 * x[1])]),
        lambda x, u: jnp.stack([jnp.sin(x[0]), x[1] + 0.1 * x[0] ** 2]),
        jnp.diag(theta["q"]),
        jnp.diag(theta["r"]),
        sp.Gaussian(jnp.array([0.2, 0.0]), jnp.diag(theta["p"])),
    )
    return sp.filter(model, Y, None, method).log_likelihood


def _theta(q=(0.02, 0.03), r=(0.1, 0.2), p=(0.3, 0.5)):
    return {"g": jnp.float64(1.3), "q": jnp.array(q), "r": jnp.array(r), "p": jnp.array(p)}


def _check(method, theta, which):
    value = jax.jit(lambda t: _likelihood(method, t))
    gradient = jax.grad(lambda t: _likelihood(method, t))(theta)
    for name in which:
        flat = np.atleast_1d(theta[name])
        for i in range(flat.size):

            def at(step, name=name, i=i, flat=flat):
                moved = flat.copy()
                moved[i] += step
                return float(value({**theta, name: jnp.asarray(moved).reshape(theta[name].shape)}))

            h = 1e-5
            if flat[i] == 0:  # a variance cannot go below zero: one-sided, third order
                difference = (-11 * at(0) + 18 * at(h) - 9 * at(2 * h) + 2 * at(3 * h)) / (6 * h)
            else:
                difference = (at(h) - at(-h)) / (2 * h)
            np.testing.assert_allclose(
                np.atleast_1d(gradient[name])[i], difference, rtol=1e-5, atol=1e-5, err_msg=f"{name}[{i}]"
            )


@pytest.mark.parametrize("name", METHODS)
def test_gradient_is_that_of_finite_differences(name):
    _check(METHODS[name], _theta(), ("g", "q", "r", "p"))


@pytest.mark.parametrize("name", [n for n in METHODS if n != "augmented"])
def test_gradient_where_process_noise_is_zero(name):
    """A zero in Q has an infinite derivative in its factor; the likelihood has not."""
    _check(METHODS[name], _theta(q=(0.0, 0.03)), ("g", "q", "r", "p"))
    _check(METHODS[name], _theta(q=(0.0, 0.0)), ("g", "q", "r"))


@pytest.mark.parametrize("name", [n for n in METHODS if n != "augmented"])
def test_gradient_where_a_sensor_or_the_start_is_exact(name):
    # Not with respect to the zero itself: it makes the posterior singular, and its factor has no derivative there.
    _check(METHODS[name], _theta(r=(0.0, 0.2)), ("g", "q"))
    _check(METHODS[name], _theta(p=(0.0, 0.0)), ("g", "q", "r"))


@pytest.mark.parametrize("name", METHODS)
def test_gradient_is_finite_where_everything_is_exact(name):
    gradient = jax.grad(lambda t: _likelihood(METHODS[name], t))(_theta(q=(0.0, 0.0), p=(0.0, 0.0)))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))


def test_second_derivatives_agree_with_differences_of_the_gradient():
    """With respect to a parameter of the model and to a noise, forward over reverse and reverse over reverse."""

    def of(v, method):
        return _likelihood(method, {**_theta(), "g": v[0], "r": jnp.stack([v[1], v[1]])})

    v = jnp.array([1.3, 0.2])
    for method in (sp.ekf(), sp.srekf(), sp.srcdkf()):
        gradient = jax.jit(jax.grad(lambda v, m=method: of(v, m)))
        h = 1e-5
        difference = np.stack([(gradient(v + h * e) - gradient(v - h * e)) / (2 * h) for e in np.eye(2)])
        for outer in (jax.jacfwd, jax.jacrev):
            np.testing.assert_allclose(outer(gradient)(v), difference, rtol=1e-5, atol=1e-5)
