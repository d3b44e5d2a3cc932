"""The double inverted pendulum against Lagrange's equations by automatic differentiation, and what must not change."""

import jax
import jax.numpy as jnp
import numpy as np

from sigmapoint.problems import pendulum
from sigmapoint.problems.pendulum import TRUTH, Parameters

OTHER = Parameters(0.3, 0.8, 1.1, 0.4, 0.9)


def centres(p, q):
    """Places of the cart and of the centres of both rods."""
    x, one, two = q
    joint = jnp.stack([x - 2 * p.l1 * jnp.sin(one), 2 * p.l1 * jnp.cos(one)])
    return jnp.stack([
        jnp.stack([x, jnp.zeros_like(x)]),
        jnp.stack([x - p.l1 * jnp.sin(one), p.l1 * jnp.cos(one)]),
        joint + jnp.stack([-p.l2 * jnp.sin(two), p.l2 * jnp.cos(two)]),
    ])  # fmt: skip


def energies(p, q, v):
    """Kinetic and potential energy, from velocities of the centres and rotations about them."""
    places, velocities = jax.jvp(lambda q: centres(p, q), (q,), (v,))
    masses = jnp.array([p.M, p.m1, p.m2])
    inertias = jnp.array([p.m1 * (2 * p.l1) ** 2, p.m2 * (2 * p.l2) ** 2]) / 12
    kinetic = 0.5 * masses @ jnp.sum(velocities**2, axis=1) + 0.5 * inertias @ v[1:] ** 2
    return kinetic, pendulum.GRAVITY * masses @ places[:, 1]


def lagranges(p, q, v, force):
    """Accelerations from the Lagrangian alone."""

    def lagrangian(q, v):
        kinetic, potential = energies(p, q, v)
        return kinetic - potential

    momentum = jax.grad(lagrangian, 1)
    right = jnp.array([force, 0.0, 0.0]) + jax.grad(lagrangian)(q, v) - jax.jacobian(momentum)(q, v) @ v
    return jnp.linalg.solve(jax.hessian(lagrangian, 1)(q, v), right)


def test_accelerations_are_lagranges():
    q, v = jax.random.uniform(jax.random.key(0), (2, 50, 3), minval=-3.0, maxval=3.0)
    force = jnp.linspace(-20.0, 20.0, 50)
    found, expected = (jax.jit(jax.vmap(f, (None, 0, 0, 0))) for f in (pendulum.accelerations, lagranges))
    for p in (TRUTH, OTHER):
        np.testing.assert_allclose(found(p, q, v, force), expected(p, q, v, force), rtol=1e-10, atol=1e-10)


START = jnp.array([0.5, 0.1, np.deg2rad(25.0), -0.3, np.deg2rad(-24.0), 0.2])


def swung(step, seconds=1.0):
    def one(state, _):
        return pendulum.moved(TRUTH, state, jnp.array(0.0), step), None

    return jax.lax.scan(one, START, length=round(seconds / step))[0]


def energy(state):
    return sum(energies(TRUTH, state[::2], state[1::2]))


def test_energy_stays_without_a_force_and_its_error_is_of_fourth_order():
    np.testing.assert_allclose(energy(swung(1e-3)), energy(START), rtol=1e-9)
    coarse, fine = (jnp.abs(swung(step) - swung(1e-3)).max() for step in (0.005, 0.0025))
    assert 10 < coarse / fine < 25  # 16 for halved steps


def test_upright_and_hanging_are_at_rest():
    for one, two in ((0.0, 0.0), (np.pi, np.pi), (0.0, np.pi)):
        state = jnp.array([0.7, 0.0, one, 0.0, two, 0.0])
        np.testing.assert_allclose(pendulum.derivative(TRUTH, state, jnp.array(0.0)), 0.0, atol=1e-13)


def test_a_common_factor_of_the_masses_shows_only_under_a_force():
    heavier = Parameters(*TRUTH[:2], *(1.3 * m for m in TRUTH[2:]))
    for force, same in ((0.0, True), (5.0, False)):
        one, other = (pendulum.moved(p, START, jnp.array(force)) for p in (TRUTH, heavier))
        assert bool(jnp.abs(one - other).max() < 1e-13) == same


def test_a_rod_that_has_passed_the_horizontal_has_fallen():
    states = jnp.zeros((4, 6)).at[1, 2].set(1.6).at[2, 4].set(-1.6).at[3, 4].set(1.5)
    assert pendulum.fallen(states).tolist() == [False, True, True, False]


def test_a_fall_begins_at_its_start_and_is_pushed():
    quiet = pendulum.fall(TRUTH, START, jnp.zeros(3), jnp.zeros((3, 6)))
    np.testing.assert_array_equal(quiet[0], START)
    np.testing.assert_allclose(quiet[2], pendulum.moved(TRUTH, quiet[1], jnp.array(0.0)), rtol=1e-14)
    pushed = pendulum.fall(TRUTH, START, jnp.full(3, 5.0), jnp.full((3, 6), 0.1))
    np.testing.assert_allclose(pushed[1], pendulum.moved(TRUTH, START, jnp.array(5.0)) + 0.1, rtol=1e-14)
