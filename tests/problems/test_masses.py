"""Two masses on springs: the modes are those of the equations of motion, and what a Nyquist step shows."""

import jax.numpy as jnp
import numpy as np
from scipy.linalg import eigh, expm

from sigmapoint.problems import masses

TIME = 0.37


def test_a_step_is_the_exponential_of_the_equations_of_motion():
    k, c = 1.0, 4.0  # N/m, for 1 kg
    stiffness = np.array([[k + c, -c], [-c, k + c]])
    np.testing.assert_allclose(np.sqrt(eigh(stiffness, eigvals_only=True)), masses.TRUTH, rtol=1e-12)
    exact = expm(TIME * np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, np.zeros((2, 2))]]))
    x = np.array([0.3, -0.7, 1.1, 0.4])
    y, v = masses.SHAPES @ x[:2], masses.SHAPES @ x[2:]
    after = masses.moved(jnp.asarray(masses.TRUTH), jnp.asarray(x), jnp.array(TIME))
    expected = exact @ np.concatenate([y, v])
    np.testing.assert_allclose(masses.places(after), expected[:2], rtol=1e-12)
    np.testing.assert_allclose(masses.SHAPES @ after[2:], expected[2:], rtol=1e-12)


def test_at_nyquist_a_mode_above_looks_like_one_below_with_its_phase_reversed():
    dt, above = jnp.pi / masses.TRUTH[1], jnp.array([0.0, 0.2])
    x = jnp.array([0.3, -0.7, 1.1, 0.4])
    mirrored = x.at[3].mul(-(masses.TRUTH[1] - 0.2) / (masses.TRUTH[1] + 0.2))
    one, other = masses.TRUTH + above, masses.TRUTH - above
    for _ in range(5):
        x, mirrored = masses.moved(one, x, dt), masses.moved(other, mirrored, dt)
        np.testing.assert_allclose(masses.places(x), masses.places(mirrored), rtol=1e-10)
