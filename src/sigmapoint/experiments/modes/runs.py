"""Runs of estimating two frequencies with their motion: random motions and starts, one program a method."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import sigmapoint as sp
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel
from sigmapoint.problems import masses

STEPS = 200
DRIFT = 1e-8
"""variance gained in a step, of that of the prior"""
KEPT = ("mean", "std")
CLOSE = 0.01
"""of the true frequency"""


class Case(NamedTuple):
    """What a run is done under."""

    rate: float
    """sampling rate over the Nyquist rate of ω₂"""
    prior: float
    """standard deviation of the logarithm of a frequency at the start, and what the filter is told of it"""
    rest: bool
    """whether the masses start without speed"""

    @property
    def text(self) -> str:
        """In words."""
        start = ", from rest" if self.rest else ""
        return f"{self.rate:g} × Nyquist, starts ±{100 * self.prior:g} %{start}"


class Way(NamedTuple):
    """A filter, and where its transition matrix comes from."""

    method: Method
    note: str
    terms: int = 0
    """of the series that its transition matrix is `truncated` to; 0: the derivatives of the transition itself"""


class Found(NamedTuple):
    """One row a run, one column a step; ω₁ and ω₂ last [rad/s]."""

    value: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @property
    def close(self) -> Float[np.ndarray, "R 2"]:
        """1 for a frequency that ends within 1 %."""
        return 1.0 * (np.abs(self.value[:, -1] / masses.TRUTH - 1) < CLOSE)

    @property
    def both(self) -> Float[np.ndarray, " R"]:
        """1 where both do."""
        return self.close.min(1)

    @property
    def inside(self) -> Float[np.ndarray, "R 2"]:
        """1 for a frequency that ends in its 95 % interval."""
        return 1.0 * ((self.low[:, -1] <= masses.TRUTH) & (self.high[:, -1] >= masses.TRUTH))


class Drawn(NamedTuple):
    """Random numbers of the runs, the same in all cases."""

    motion: Float[Array, "R 4"]
    start: Float[Array, "R 2"]
    keys: Array


def draw(runs: int, key: Array) -> Drawn:
    """Of the runs."""
    keys = jax.random.split(key, 3)
    return Drawn(
        jax.random.normal(keys[0], (runs, 4)), jax.random.normal(keys[1], (runs, 2)), jax.random.split(keys[2], runs)
    )


def estimator(way: Way) -> Callable[[Case, Drawn], Found]:
    """All runs of a case, by one program for all cases."""

    def one(rate: Array, prior: Array, moving: Array, drawn: Drawn) -> Any:
        truth, scale = jnp.asarray(masses.TRUTH), jnp.asarray(masses.SCALE)
        dt = jnp.pi / truth[1] / rate
        speeds = jnp.concatenate([jnp.ones(2), jnp.broadcast_to(moving, (2,))])
        y = simulated(drawn.motion * scale * speeds, dt, drawn.keys)
        first = truth * jnp.exp(prior * drawn.start)
        unknown = masses.Start(jnp.zeros(4), scale)
        theta = sp.positive(first, prior * first)

        def model(dt: Array) -> StateSpaceModel:
            return sp.joint(lambda omega: masses.model(omega, dt, unknown), theta, drift=DRIFT)

        run = sp.filter(truncated(model, dt, way.terms) if way.terms else model(dt), y, method=way.method, keep=KEPT)
        found = sp.estimates(theta, run)
        return Found(found.value, found.low, found.high)

    program = jax.jit(jax.vmap(one, (None, None, None, 0)))

    def estimate(case: Case, drawn: Drawn) -> Found:
        given = (case.rate, case.prior, 1.0 - case.rest)
        return jax.tree.map(np.asarray, program(*map(jnp.asarray, given), drawn))

    return estimate


def truncated(model: Callable[[Array], StateSpaceModel], dt: Float[Array, ""], terms: int) -> StateSpaceModel:
    """A model that tells extended filters I + AΔt + (AΔt)²/2 + … for its transition's Jacobian.

    A = ∂ẋ/∂x is that before the step, held. The mean still moves by the transition itself.

    Args:
        model: by its time step.
        dt: that to be taken.
        terms: of the series, after I.
    """

    def rate(x: Array) -> Array:
        return jax.jvp(lambda t: model(t).dynamics(x, None), (jnp.zeros_like(dt),), (jnp.ones_like(dt),))[1]

    def jacobian(x: Array, u: Any) -> Array:
        A, term = dt * jax.jacfwd(rate)(x), jnp.eye(len(x))
        total = term
        for i in range(1, terms + 1):
            term = term @ A / i
            total = total + term
        return total

    return replace(model(dt), dynamics_jacobian=jacobian)


def simulated(x: Float[Array, "4"], dt: Float[Array, ""], key: Array) -> Float[Array, "T 2"]:
    """Places as measured [m], from a state on."""
    noise = jax.random.normal(key, (STEPS, 6))

    def step(x: Array, noise: Array) -> tuple[Array, Array]:
        y = masses.places(x) + masses.MEASUREMENT * noise[:2]
        disturbance = masses.PROCESS * jnp.asarray(masses.SCALE) * noise[2:]
        return masses.moved(jnp.asarray(masses.TRUTH), x, dt) + disturbance, y

    return jax.lax.scan(step, x, noise)[1]
