"""What the sensors' noise leaves of the pendulum's upright position, whatever the filter and the controller.

Near upright the motion is linear, x⁺ = A x + B u + w, y = H x + v, and with Gaussian noises the least E[xᵀQx] that any
causal controller keeps in the long run is that of the Kalman filter with the linear regulator:

    E[xᵀQx] = tr(Q P⁺) + tr(S K⁺)      P⁺ = P − K⁺,   K⁺ = P Hᵀ (H P Hᵀ + V)⁻¹ H P

with P the stationary covariance before a measurement and S the solution of the regulator's Riccati equation with no
cost of the force. Q counts both angles; that of the cart and of the force is small enough to be of no account.

Source: Anderson & Moore, "Optimal Control: Linear Quadratic Methods" (1990), chapter 8.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_discrete_are

from sigmapoint.problems.pendulum import TRUTH
from sigmapoint.problems.pendulum_adaptive import DISTURBANCE
from sigmapoint.problems.pendulum_control import factored, held
from sigmapoint.problems.pendulum_state import MEASURED

FREE = 1e-11
"""cost of the squares of the force [N] and of the cart's place [m], beside those of the angles [rad]: a tenth of it
changes the result by less than a hundredth"""


def least_angle(sensors: Float[np.ndarray, " 3"]) -> float:
    """[°] least root of the mean of θ₁² + θ₂².

    Args:
        sensors: standard deviations of their noise [m, m/s, rad].

    Examples:
        >>> import numpy as np
        >>> from sigmapoint.experiments.pendulum_state.limit import least_angle
        >>> small, large = (least_angle(np.array([0.1, 0.1, 0.01]) * times) for times in (1.0, 10.0))
        >>> 5 < large / small < 10
        True
    """
    A, B = (np.asarray(part) for part in held(factored(TRUTH, jnp.zeros(6))))
    H, V = np.eye(6)[:MEASURED], np.diag(sensors**2)
    P = solve_discrete_are(A.T, H.T, DISTURBANCE**2 * np.eye(6), V)
    seen = P @ H.T @ np.linalg.solve(H @ P @ H.T + V, H @ P)
    Q = np.diag([FREE, 0.0, 1.0, 0.0, 1.0, 0.0])
    S = solve_discrete_are(A, B, Q, np.array([[FREE]]))
    return float(np.rad2deg(np.sqrt(np.trace(Q @ (P - seen)) + np.trace(S @ seen))))
