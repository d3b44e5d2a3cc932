"""Iterated measurement updates that count the measurement once.

Every pass linearises h about the latest posterior and conditions the *prior* on it. With x = m + L ξ the prior is
ξ ~ N(0, I) and a posterior ξ ~ N(μ, T Tᵀ); a linearisation about it, h ≈ ȳ + Ψ (ξ − μ) + E ε, predicts y at ξ = 0 as
ȳ − Ψ μ. For the Taylor rule this is the iterated extended Kalman filter (Gauss-Newton on the posterior; Bell & Cathey
1993), for sigma points iterated posterior linearisation (García-Fernández, Svensson & Särkkä 2015). Working in ξ keeps
T well scaled whatever the units of the state.
"""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from sigmapoint.belief import Belief
from sigmapoint.carry import Functions, whitened
from sigmapoint.compiled.native import applied
from sigmapoint.conditioning import Joint, condition
from sigmapoint.rules.linearization import Linearization, Rule


def relinearized(
    rule: Rule,
    passes: int,
    first: Joint,
    belief: Belief,
    fs: Functions,
    y: Float[Array, " d"],
    u: Any,
    active: Bool[Array, " m"],
) -> tuple[Joint, Float[Array, " m"]]:
    """The joint after `passes` more linearisations, and the innovation that belongs to it."""
    joint, innovation = first, fs.innovation(y, first.value.mean, active)
    n, N = belief.factor.shape[0], first.value.slope.shape[1]
    entry = fs.observation.within(fs.h, fs.observation_space)
    at = whitened(belief, fs.state_space)

    def g(xi: Array) -> Array:
        return entry.call(at(xi[:n]), u, xi[n:])

    origin = jnp.zeros(N, y.dtype)
    nothing = jnp.zeros((N, 0), y.dtype)
    coordinates = Linearization(origin, jnp.eye(N, dtype=y.dtype), nothing, origin, nothing)
    for _ in range(passes):
        given = condition(joint._replace(state=coordinates), innovation[:, None], active, type(belief))
        mu = given.step[:, 0]
        value = rule.about(g, mu, given.root, fs.observation_space)
        joint = first._replace(value=value)
        innovation = fs.innovation(y, value.mean, active) + jnp.where(active, applied(value.slope, mu), 0.0)
    return joint, innovation
