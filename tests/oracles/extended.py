"""The extended Kalman filter and its iterated form, with Jacobians given by the caller.

Sources: UKF chapter, Table 7.2.1, eqs. 7.24-7.28; B. M. Bell and F. W. Cathey, "The Iterated Kalman Filter Update as a
Gauss-Newton Method", IEEE Trans. Automatic Control 38, 1993. `f(x, u)` and `h(x, u)` are the functions at zero noise.
"""

from typing import Any

import numpy as np

from .gaussian import Array, Belief, FilterResult, First, Function, Update, noise_at, row, run, vector
from .kalman import kalman_predict, kalman_update


def iterated_update(
    h: Function, jacobian: Function, R: Array, m: Array, P: Array, y: Array, iterations: int = 1
) -> Update:
    """Linearise h at the iterate, update the prior (m, P), repeat: the data are counted once; one iteration is the EKF.

    The innovation, its covariance and the log density are those of the last linearisation, at the predicted mean m.
    """
    at = m
    for _ in range(iterations):
        H = np.atleast_2d(np.asarray(jacobian(at), dtype=np.float64))
        update = kalman_update(m, P, H, vector(h(at)) - H @ at, R, y)
        at = update.mean
    return update


def extended_kalman_filter(
    f: Function,
    h: Function,
    f_jacobian: Function,
    h_jacobian: Function,
    Q: Array,
    R: Array,
    m0: Array,
    P0: Array,
    y: Array,
    u: Any = None,
    f_noise_jacobian: Function | None = None,
    h_noise_jacobian: Function | None = None,
    iterations: int = 1,
    first: First = "update",
) -> FilterResult:
    """Table 7.2.1 with A = f_jacobian(x, u), C = h_jacobian(x, u), and B, D the noise Jacobians, None for I.

    `iterations` above one is the iterated EKF; D is then taken at the predicted mean.
    """

    def noise(jacobian: Function | None, cov: Array, x: Array, k: int) -> Array:
        if jacobian is None:
            return cov
        B = np.asarray(jacobian(x, row(u, k)), dtype=np.float64)
        return B @ cov @ B.T

    def predict(belief: Belief, k: int) -> Belief:
        m = belief.mean
        A = np.atleast_2d(np.asarray(f_jacobian(m, row(u, k)), dtype=np.float64))
        offset = vector(f(m, row(u, k))) - A @ m
        return kalman_predict(m, belief.cov, A, offset, noise(f_noise_jacobian, noise_at(Q, k), m, k))

    def update(belief: Belief, y_k: Array, k: int) -> Update:
        R_k = noise(h_noise_jacobian, noise_at(R, k), belief.mean, k)
        u_k = row(u, k)
        return iterated_update(
            lambda x: h(x, u_k), lambda x: h_jacobian(x, u_k), R_k, belief.mean, belief.cov, y_k, iterations
        )

    return run(predict, update, m0, P0, y, first)
