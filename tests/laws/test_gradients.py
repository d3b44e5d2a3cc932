"""The derivative of the log-likelihood is that of finite differences, also where a covariance is zero."""

from functools import partial

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


# Where the covariances vanish, and what to differentiate there. A zero in Q has an infinite derivative in its factor;
# the likelihood has not. An exact sensor makes the posterior singular, whose factor has no derivative with respect to
# the zero itself.
POINTS = {
    "regular": (_theta(), ("g", "q", "r", "p")),
    "one zero in Q": (_theta(q=(0.0, 0.03)), ("g", "q", "r", "p")),
    "Q zero": (_theta(q=(0.0, 0.0)), ("g", "q", "r")),
    "exact sensor": (_theta(r=(0.0, 0.2)), ("g", "q")),
    "exact start": (_theta(p=(0.0, 0.0)), ("g", "q", "r")),
}


# A belief of each kind with derivatives and with points, points in the noise, and an update that is repeated.
SOME = ("ekf", "srcdkf", "augmented", "iterated")


@pytest.mark.parametrize(
    "name", [name if name in SOME else pytest.param(name, marks=pytest.mark.slow) for name in METHODS]
)
def test_gradient_is_that_of_finite_differences(name):
    likelihood = partial(_likelihood, METHODS[name])
    value, both = jax.jit(likelihood), jax.jit(jax.value_and_grad(likelihood))
    for place, (theta, which) in POINTS.items():
        if name == "augmented" and place != "regular":
            continue  # the noise is in the points: their derivative is that of the factor
        gradient = both(theta)[1]
        for leaf in which:
            for i in range(np.size(theta[leaf])):
                got, expected = np.atleast_1d(gradient[leaf])[i], _difference(value, theta, leaf, i)
                np.testing.assert_allclose(got, expected, rtol=1e-5, atol=1e-5, err_msg=f"{place}: {leaf}[{i}]")
    exact = both(_theta(q=(0.0, 0.0), p=(0.0, 0.0)))[1]
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(exact))


def _difference(value, theta, name, i):
    flat = np.atleast_1d(theta[name])

    def at(step):
        moved = flat.copy()
        moved[i] += step
        return float(value({**theta, name: jnp.asarray(moved).reshape(theta[name].shape)}))

    h = 1e-5
    if flat[i] == 0:  # a variance cannot go below zero: one-sided, third order
        return (-11 * at(0) + 18 * at(h) - 9 * at(2 * h) + 2 * at(3 * h)) / (6 * h)
    return (at(h) - at(-h)) / (2 * h)


@pytest.mark.parametrize(
    "method",
    [sp.srcdkf(), pytest.param(sp.ekf(), marks=pytest.mark.slow), pytest.param(sp.srekf(), marks=pytest.mark.slow)],
    ids=str,
)
def test_second_derivatives_agree_with_differences_of_the_gradient(method):
    """With respect to a parameter of the model and to a noise, forward over reverse and reverse over reverse."""

    def of(v):
        return _likelihood(method, {**_theta(), "g": v[0], "r": jnp.stack([v[1], v[1]])})

    v = jnp.array([1.3, 0.2])
    gradient, h = jax.jit(jax.grad(of)), 1e-5
    difference = np.stack([(gradient(v + h * e) - gradient(v - h * e)) / (2 * h) for e in np.eye(2)])
    for outer in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(outer(gradient)(v), difference, rtol=1e-5, atol=1e-5)


def test_user_jacobians_change_no_derivative_of_the_likelihood():
    """The Jacobian moves with the estimate, and so with every parameter."""
    u = jnp.arange(20.0)
    y = 8 * jnp.abs(jnp.sin(u))[:, None]

    def likelihood(t, **jacobians):
        def f(x, u):
            return 0.5 * x + t * x / (1 + x**2) + 8 * jnp.cos(1.2 * u)

        start = sp.Gaussian(jnp.ones(1), jnp.eye(1))
        model = sp.StateSpaceModel(f, lambda x, u: x**2 / 20, jnp.eye(1), 0.5 * jnp.eye(1), start, **jacobians)
        return sp.filter(model, y, u, sp.ekf()).log_likelihood

    def given(t):
        slope = lambda x, u: jnp.diag(0.5 + t * (1 - x**2) / (1 + x**2) ** 2)  # noqa: E731
        return likelihood(t, dynamics_jacobian=slope, observation_jacobian=lambda x, u: x[None] / 10)

    np.testing.assert_allclose(given(25.0), likelihood(25.0), rtol=1e-12)
    for derivative in (jax.grad, jax.hessian):
        np.testing.assert_allclose(jax.jit(derivative(given))(25.0), jax.jit(derivative(likelihood))(25.0), rtol=1e-9)


@pytest.mark.parametrize("method", [sp.ekf(), sp.srekf(), sp.srcdkf()], ids=str)
def test_gradient_on_a_manifold_whose_difference_depends_on_the_point(method):
    ratio = sp.Manifold(lambda a, b: a / b - 1, lambda m, d: m * (1 + d))
    y = jnp.log(2 + 0.3 * jnp.sin(jnp.arange(15.0)))[:, None]

    def likelihood(q):
        model = sp.StateSpaceModel(
            lambda x, u: 1.0 + 0.5 * x + 0.1 * jnp.sin(x) * x,
            lambda x, u: jnp.log(x),
            q * jnp.eye(1),
            0.05 * jnp.eye(1),
            sp.Gaussian(jnp.array([2.0]), 0.1 * jnp.eye(1)),
            state_space=ratio,
        )
        return sp.filter(model, y, method=method).log_likelihood

    value, h = jax.jit(likelihood), 1e-6
    difference = (value(0.02 + h) - value(0.02 - h)) / (2 * h)
    np.testing.assert_allclose(jax.jit(jax.grad(likelihood))(0.02), difference, rtol=1e-6)
