"""One update of parameters seen as states: `w[k+1] = w[k] + drift`, `d[k] = G(w[k], x[k]) + noise`.

Source: Wan & van der Merwe, "The Unscented Kalman Filter" (2001), Table 7.4.1; van der Merwe & Wan, "The Square-Root
Unscented Kalman Filter for State and Parameter-Estimation" (2001), Algorithm 3.2, without its downdates: `triangular`.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Array, Float

from sigmapoint.belief import Dense
from sigmapoint.densities import LOG_2PI
from sigmapoint.learning import measurement_noise, sharding
from sigmapoint.learning.drift import Drift
from sigmapoint.learning.measurement_noise import MeasurementNoise
from sigmapoint.learning.objectives import Objective
from sigmapoint.learning.parameters import Parameters
from sigmapoint.learning.state import LearnerInfo, LearnerState, Memory, Prediction
from sigmapoint.learning.triangular import GROUPS
from sigmapoint.learning.uncertainty import Covariance, Factor
from sigmapoint.linear_algebra.factors import norm_rows, solve_lower, solve_upper
from sigmapoint.methods import Method
from sigmapoint.rules.linearization import Linearization, SigmaPointRule
from sigmapoint.spaces import Euclidean, Space, beside


class Setup(eqx.Module):
    """What is learned, from where on, and how."""

    objective: Objective
    parameters: Parameters
    method: Method = eqx.field(static=True)
    drift: Drift = eqx.field(static=True)
    noise: MeasurementNoise = eqx.field(static=True)
    mesh: Mesh | None = eqx.field(static=True)

    def start(self) -> LearnerState:
        """The state before the first sample."""
        start, std = self.parameters.start, self.parameters.std
        # A derivative needs no points, and so no covariance either: the factor alone costs less.
        dense = self.method.belief is Dense and isinstance(self.method.rule, SigmaPointRule)
        state = LearnerState(
            jnp.array(start),  # a copy, so that a state may be given away
            (Covariance if dense else Factor).of(std),
            self.drift.start(std**2),
            jnp.asarray(self.noise.value, start.dtype),
            self.initial_memory,
            jnp.zeros((), int),
        )
        return sharding.spread(state, self.mesh, start.shape[0])

    @property
    def initial_memory(self) -> Memory:
        """What a recurrent function remembers before the first input of a series."""
        start = self.parameters.start
        remembered = jnp.array(self.objective.remembered(start.dtype))  # a copy, as above
        directions = jax.eval_shape(self.objective.memory_space.residual, remembered, remembered).shape[0]
        return Memory(remembered, jnp.zeros((directions, start.shape[0]), start.dtype))

    def checked(self, x: Any, d: Any) -> tuple[Any, Any]:
        """Inputs and targets of `values`, as arrays with a leading axis; nothing for targets that are zero."""
        return self.objective.checked(x, d, self.parameters.start.dtype)

    def values(self, w: Float[Array, " L"], x: Any) -> Float[Array, "B ..."]:
        """What should equal targets, for several inputs; of a recurrent function, for a series from its beginning."""
        memory = self.objective.remembered(w.dtype)
        return self.objective.values(self.parameters.tree(w), memory, x)[0].astype(w.dtype)

    def targets(self, x: Any, d: Array | np.ndarray | None) -> Array:
        """Those of `values`: as given, or zero.

        Raises:
            ValueError: the function does not give what is shaped like a target.
        """
        value = jax.eval_shape(self.values, self.parameters.start, x)
        if d is None:
            return jnp.zeros(value.shape, value.dtype)
        if value.shape[1:] != d.shape[1:]:
            raise ValueError(
                f"a target has shape {d.shape[1:]}, but the function gives {value.shape[1:]} for its input"
            )
        return jnp.asarray(d)


def updated(setup: Setup, state: LearnerState, x: Any, d: Any) -> tuple[LearnerState, LearnerInfo]:
    """The update, for inputs and targets with a leading axis; no targets are zeros."""
    d = setup.targets(x, d)
    B = d.shape[0]
    cov = measurement_noise.covariance(state.noise, d.size // B)
    uncertainty = setup.drift.inflated(
        state.uncertainty, setup.drift.added(state.drift, state.uncertainty.variance, state.step)
    )
    factor = uncertainty.factored
    seen, remembered = _seen(setup, state, factor, x)
    there = ~jnp.isnan(jnp.ravel(d))
    R = jnp.kron(jnp.eye(B, dtype=cov.dtype), cov)
    slope, bend = (jnp.where(there[:, None], part, 0.0) for part in (seen.slope, seen.bend))
    known = jnp.where(there[:, None] & there[None, :], R, 0.0)
    noise = known + bend @ bend.T + jnp.diag(jnp.where(there, 0.0, 1.0))
    innovation = jnp.where(there, jnp.ravel(d) - seen.mean, 0.0)
    learned = factor.updated(slope, noise, groups=GROUPS if sharding.parts(setup.mesh) == 1 else 1)
    white = solve_lower(learned.factor, innovation)
    moved = learned.gain.T @ white
    found = measurement_noise.expected(R, white, solve_lower(learned.factor, known))
    m = cov.shape[0]
    found = jnp.einsum("bibj->ij", found.reshape(B, m, B, m)) / B
    after = LearnerState(
        state.mean + moved,
        uncertainty.carried(learned.uncertainty),
        jax.tree.map(partial(jnp.where, there.any()), setup.drift.after(state.drift, moved), state.drift),
        setup.noise.after(state.noise, found),
        Memory(setup.objective.memory_space.retract(remembered.mean, remembered.slope @ moved), remembered.slope),
        state.step + 1,
    )
    nis = jnp.sum(white**2)
    count = jnp.sum(there, dtype=nis.dtype)
    log_density = -0.5 * (nis + count * LOG_2PI) - jnp.sum(jnp.log(jnp.diagonal(learned.factor)))
    info = LearnerInfo(seen.mean, jnp.where(there, innovation, jnp.nan), nis, log_density)
    return sharding.spread(after, setup.mesh, state.mean.shape[0]), info


def _seen(setup: Setup, state: LearnerState, factor: Factor, x: Any) -> tuple[Linearization, Memory]:
    """What should equal the targets, and the memory after it."""
    H, D = state.memory.mean.shape[0], state.memory.slope.shape[0]

    def both(w: Any, memory: Array) -> Array:
        values, after = setup.objective.values(w, memory, x)
        return jnp.concatenate([after, jnp.ravel(values).astype(after.dtype)])

    lin = _linearized(setup, setup.method, state, factor, both, beside(setup.objective.memory_space, H, D))
    slope = solve_upper(factor.factor, lin.slope[:D].T).T if D else lin.slope[:D]
    return Linearization(lin.mean[H:], *(part[D:] for part in lin[1:])), Memory(lin.mean[:H], slope)


def _linearized(
    setup: Setup,
    method: Method,
    state: LearnerState,
    factor: Factor,
    function: Callable[[Any, Array], Array],
    space: Space,
) -> Linearization:
    """`function(w, memory)`, where the memory depends on the parameters too, about their mean."""
    together = sharding.gathered(setup.mesh)

    def at(step: Float[Array, " L"]) -> Array:
        memory = setup.objective.memory_space.retract(state.memory.mean, state.memory.slope @ step)
        return jnp.ravel(function(setup.parameters.tree(together(state.mean + step)), memory)).astype(step.dtype)

    return method.rule(at, factor.factor, space)


def predicted(setup: Setup, state: LearnerState, x: Any) -> Prediction:
    """What the function would give for one new input."""

    def value(w: Any, memory: Array) -> Array:
        return setup.objective.prediction(w, memory, x)

    shape = jax.eval_shape(lambda s: value(setup.parameters.tree(s.mean), s.memory.mean), state).shape
    method = setup.objective.predicted_by(setup.method)
    lin = _linearized(setup, method, state, state.uncertainty.factored, value, Euclidean())
    std = norm_rows(jnp.concatenate([lin.slope, lin.bend], axis=1))
    return Prediction(lin.mean.reshape(shape), std.reshape(shape))
