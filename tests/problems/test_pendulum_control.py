"""The pendulum's controller: a factorisation that leaves nothing out, the Riccati equation, and that it holds."""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import expm, solve_discrete_are

import sigmapoint as sp
from sigmapoint.problems import pendulum, pendulum_adaptive
from sigmapoint.problems import pendulum_control as control

STATES = jax.random.normal(jax.random.key(0), (5, 6))
FORCE = 3.0


def test_the_factored_form_is_the_equations_of_motion_and_exact_where_an_angle_is_zero():
    for state in (*STATES, jnp.zeros(6).at[3].set(1.0)):
        A, B = control.factored(pendulum.TRUTH, state)
        expected = pendulum.derivative(pendulum.TRUTH, state, jnp.array(FORCE))
        np.testing.assert_allclose(A @ state + B[:, 0] * FORCE, expected, rtol=1e-11, atol=1e-11)


def test_held_systems_and_riccati_solutions_are_those_of_scipy():
    for state in STATES:
        system = control.factored(pendulum.TRUTH, state)
        A, B = control.held(system)
        exact = expm(pendulum.STEP * np.block([[system.A, system.B], [np.zeros((1, 7))]]))
        np.testing.assert_allclose(np.concatenate([A, B], axis=1), exact[:6], atol=1e-8)  # six terms of the series
        P = control.riccati(control.Linear(A, B), jnp.asarray(control.COST), control.FORCE_COST)
        P0 = solve_discrete_are(A, B, control.COST, np.array([[control.FORCE_COST]]))
        np.testing.assert_allclose(P, P0, rtol=1e-8, atol=1e-8 * np.abs(P0).max())


def test_with_everything_known_the_published_start_is_brought_back():
    start = pendulum_adaptive.Start(jnp.asarray(pendulum_adaptive.JACKKNIFE), jnp.ones(5))
    sensors = jnp.asarray(pendulum_adaptive.SENSORS)
    trial = jax.jit(
        lambda key: pendulum_adaptive.trial(sp.ekf(), pendulum_adaptive.all_known, start, sensors, 300, key)
    )(jax.random.key(1))
    assert not pendulum.fallen(trial.state).any()
    assert (np.abs(trial.state[-1, [2, 4]]) < 0.1).all()
    np.testing.assert_allclose(trial.mean[-1], trial.state[-1], atol=5 * sensors.max())
