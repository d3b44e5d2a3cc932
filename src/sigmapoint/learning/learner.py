"""Parameters as states: `w[k+1] = w[k] + drift`, `d[k] = G(w[k], x[k]) + noise`, one pair (x, d) at a time.

Source: Wan & van der Merwe, "The Unscented Kalman Filter" (2001), Table 7.4.1; van der Merwe & Wan, "The Square-Root
Unscented Kalman Filter for State and Parameter-Estimation" (2001), Algorithm 3.2, without its downdates: `triangular`.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Array, Float

from sigmapoint import checks, data_checks
from sigmapoint.belief import Dense
from sigmapoint.carry import Redraw
from sigmapoint.learning import measurement_noise, sharding
from sigmapoint.learning.drift import Drift, fixed
from sigmapoint.learning.measurement_noise import Known, MeasurementNoise
from sigmapoint.learning.objectives import Objective, listed, objective
from sigmapoint.learning.parameters import Parameters
from sigmapoint.learning.state import LearnerInfo, LearnerState, Memory, Prediction
from sigmapoint.learning.triangular import GROUPS
from sigmapoint.learning.uncertainty import Covariance, Factor
from sigmapoint.linalg import norm_rows, solve_lower, solve_upper
from sigmapoint.methods import Method, srcdkf
from sigmapoint.rules.linearization import Linearization, SigmaPointRule
from sigmapoint.spaces import Euclidean
from sigmapoint.step import LOG_2PI


class Learner(eqx.Module):
    """A function whose parameters are learned; made by `learner`. It holds no state: states go in and come out.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> learner = sp.learner(lambda w, x: w["a"] * x + w["b"], {"a": 0.0, "b": 0.0}, noise=0.01)
        >>> s = learner.init()
        >>> for x in (0.0, 1.0, 2.0):
        ...     s, info = learner.update(s, x, 3 * x - 1)
        >>> {name: round(float(value), 1) for name, value in learner.params(s).items()}
        {'a': 3.0, 'b': -1.0}
    """

    objective: Objective
    parameters: Parameters
    method: Method = eqx.field(static=True)
    drift: Drift = eqx.field(static=True)
    noise: MeasurementNoise = eqx.field(static=True)
    mesh: Mesh | None = eqx.field(static=True)

    def init(self) -> LearnerState:
        """The state before the first sample.

        Returns:
            The parameters as given, with the prior's standard deviations.

        Examples:
            >>> import sigmapoint as sp
            >>> sp.learner(lambda w, x: w * x, 0.0, noise=1.0, prior_std=2.0).init().std.tolist()
            [2.0]
        """
        start, std = self.parameters.start, self.parameters.std
        # A derivative needs no points, and so no covariance either: the factor alone costs less.
        dense = self.method.belief is Dense and isinstance(self.method.rule, SigmaPointRule)
        state = LearnerState(
            jnp.array(start),  # a copy, so that a state may be given away
            (Covariance if dense else Factor).of(std),
            self.drift.start(std**2),
            jnp.asarray(self.noise.value, start.dtype),
            self.forgotten,
            jnp.zeros((), int),
        )
        return sharding.spread(state, self.mesh, start.shape[0])

    @property
    def forgotten(self) -> Memory:
        """What a recurrent function remembers before the first input of a series."""
        start = self.parameters.start
        remembered = jnp.array(self.objective.remembered(start.dtype))  # a copy, as above
        return Memory(remembered, jnp.zeros((remembered.shape[0], start.shape[0]), start.dtype))

    def params(self, state: LearnerState) -> Any:
        """The parameters, as the pytree they were given in.

        Args:
            state: from `init` or `update`.

        Returns:
            Their means.
        """
        return self.parameters.tree(state.mean)

    def std_params(self, state: LearnerState) -> Any:
        """Standard deviations of the parameters, as the pytree they were given in.

        Args:
            state: from `init` or `update`.

        Returns:
            Them, in place of the parameters.
        """
        return self.parameters.tree(state.std)

    def update(self, state: LearnerState, x: Any, d: Any) -> tuple[LearnerState, LearnerInfo]:
        """Learn from one pair.

        Args:
            state: from `init` or `update`.
            x: the input, any pytree; `function(params, x)` predicts `d`.
            d: the target, any shape; NaN where it is not known.

        Returns:
            The new state, and what the target looked like.

        Raises:
            ValueError: a target of another shape than the prediction or the noise, NaN or infinity in `x`, infinity in
                `d`.
        """
        checks.unmasked("target", d)
        return self.update_batch(state, jax.tree.map(_alone, x), jax.tree.map(_alone, d, is_leaf=listed))

    def update_batch(self, state: LearnerState, x: Any, d: Any) -> tuple[LearnerState, LearnerInfo]:
        """Learn from several pairs at once, as one long target.

        Args:
            state: from `init` or `update`.
            x: inputs, any pytree whose leaves have a leading axis B; a recurrent function takes them in this order.
            d: targets (B, ...); NaN where they are not known.

        Returns:
            The new state, and what the targets looked like.

        Raises:
            ValueError: as `update`.
        """
        return _updated(self, state, *self.checked(x, d))

    def predict(self, state: LearnerState, x: Any) -> Prediction:
        """What the function would give for a new input, and how sure that is.

        Args:
            state: from `init` or `update`.
            x: one input; for many, `jax.vmap(lambda x: learner.predict(state, x))(xs)`.

        Returns:
            Mean and standard deviation, of the shape of a target.

        Raises:
            ValueError: NaN or infinity in `x`; a residual without `predict`.

        Examples:
            >>> import sigmapoint as sp
            >>> line = sp.learner(lambda w, x: w * x, 2.0, noise=1.0, prior_std=0.5)
            >>> mean, std = line.predict(line.init(), 10.0)
            >>> float(mean), round(float(std), 6)
            (20.0, 5.0)
        """
        return _predicted(self, state, data_checks.inputs(x, None, self.parameters.start.dtype, "input"))

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


def learner(
    function: Callable[[Any, Any], Any] | Objective,
    w0: Any,
    *,
    noise: Any,
    method: Method | None = None,
    drift: Drift | None = None,
    prior_std: Any = 1.0,
    devices: Sequence[Any] | None = None,
) -> Learner:
    """Learn the parameters of a function from pairs of inputs and targets, one at a time, with error bars.

    Args:
        function: `function(w, x)`, the prediction for input `x`, any shape; or what `residual`, `cross_entropy` or
            `recurrent` make.
        w0: where to start: any pytree of floating-point arrays and numbers (dicts, Equinox modules). Other leaves stay
            as they are.
        noise: how far targets are from a perfect prediction: one variance for all elements of a target, one for each,
            or a covariance (m, m), in squared units of the targets; or `learned_noise(...)`. A state carries it on.
        method: `srcdkf()` where not given; its points stay √3 standard deviations out, those of `srukf()` √L. Square
            roots and `ekf` cost O(M L²) for M elements of a target and L parameters, the other dense ones O(L³).
        drift: how much parameters may move between samples; `fixed(0)` where not given.
        prior_std: how far `w0` may be off: a number, or a pytree like `w0`.
        devices: those that parameters and the rows of their factor are spread over, for example `jax.devices()`; the
            number of parameters must be a multiple of theirs.

    Returns:
        A `Learner`: `init`, `update`, `params`, `predict`.

    Raises:
        ValueError: no parameters, parameters of several types, a noise that is not positive, a negative deviation, a
            method that is iterated or carries points, parameters that cannot be spread evenly over the devices.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> net = sp.learner(lambda w, x: jnp.tanh(w["in"] @ x) @ w["out"],
        ...                  {"in": jnp.ones((3, 2)), "out": jnp.ones(3)}, noise=0.1, drift=sp.forgetting(0.999))
        >>> s, info = net.update(net.init(), jnp.ones(2), 0.5)
        >>> s.mean.shape, info.prediction.shape
        ((9,), (1,))
    """
    learned = objective(function)
    method = srcdkf() if method is None else method
    checks.instance("method", method, Method)
    if method.iterations > 1 or not isinstance(method.carry, Redraw):
        raise ValueError("learner: the method must not be iterated, augmented or extended")
    drift = fixed(0.0) if drift is None else drift
    checks.instance("drift", drift, Drift, "sp.fixed(), sp.annealed(), sp.forgetting() or sp.robbins_monro()")
    known = noise if isinstance(noise, MeasurementNoise) else Known(measurement_noise.checked("noise", noise))
    parameters = Parameters.of(w0, prior_std)
    L = parameters.start.shape[0]
    if isinstance(method.rule, SigmaPointRule):
        checks.digits(abs(method.rule.constants(L).centre), parameters.start.dtype)
    return Learner(learned, parameters, method, drift, known, sharding.mesh(devices, L))


def _alone(a: Any) -> Any:
    checks.unmasked("input", a)
    return a[None] if isinstance(a, jax.Array) else np.asarray(a)[None]


@eqx.filter_jit
def _updated(learner: Learner, state: LearnerState, x: Any, d: Any) -> tuple[LearnerState, LearnerInfo]:
    return updated(learner, state, x, d)


def updated(learner: Learner, state: LearnerState, x: Any, d: Any) -> tuple[LearnerState, LearnerInfo]:
    """The update, for inputs and targets with a leading axis; no targets are zeros."""
    d = learner.targets(x, d)
    B = d.shape[0]
    cov = measurement_noise.covariance(state.noise, d.size // B)
    uncertainty = learner.drift.inflated(
        state.uncertainty, learner.drift.added(state.drift, state.uncertainty.variance, state.step)
    )
    factor = uncertainty.factored
    seen, remembered = _seen(learner, state, factor, x, d.size)
    there = ~jnp.isnan(jnp.ravel(d))
    R = jnp.kron(jnp.eye(B, dtype=cov.dtype), cov)
    slope, bend = (jnp.where(there[:, None], part, 0.0) for part in (seen.slope, seen.bend))
    known = jnp.where(there[:, None] & there[None, :], R, 0.0)
    noise = known + bend @ bend.T + jnp.diag(jnp.where(there, 0.0, 1.0))
    innovation = jnp.where(there, jnp.ravel(d) - seen.mean, 0.0)
    learned = factor.updated(slope, noise, groups=GROUPS if sharding.parts(learner.mesh) == 1 else 1)
    white = solve_lower(learned.factor, innovation)
    moved = learned.gain.T @ white
    found = measurement_noise.expected(R, white, solve_lower(learned.factor, known))
    m = cov.shape[0]
    found = jnp.einsum("bibj->ij", found.reshape(B, m, B, m)) / B
    after = LearnerState(
        state.mean + moved,
        uncertainty.carried(learned.uncertainty),
        jax.tree.map(partial(jnp.where, there.any()), learner.drift.after(state.drift, moved), state.drift),
        learner.noise.after(state.noise, found),
        Memory(remembered.mean + remembered.slope @ moved, remembered.slope),
        state.step + 1,
    )
    nis = jnp.sum(white**2)
    count = jnp.sum(there, dtype=nis.dtype)
    log_density = -0.5 * (nis + count * LOG_2PI) - jnp.sum(jnp.log(jnp.diagonal(learned.factor)))
    info = LearnerInfo(seen.mean, jnp.where(there, innovation, jnp.nan), nis, log_density)
    return sharding.spread(after, learner.mesh, state.mean.shape[0]), info


def _seen(learner: Learner, state: LearnerState, factor: Factor, x: Any, size: int) -> tuple[Linearization, Memory]:
    """What should equal the targets, `size` numbers, and the memory after it."""

    def both(w: Any, memory: Array) -> Array:
        values, after = learner.objective.values(w, memory, x)
        return jnp.concatenate([jnp.ravel(values).astype(after.dtype), after])

    lin = _linearized(learner, learner.method, state, factor, both)
    slope = lin.slope[size:]
    slope = solve_upper(factor.factor, slope.T).T if slope.size else slope
    return Linearization(*(part[:size] for part in lin)), Memory(lin.mean[size:], slope)


def _linearized(
    learner: Learner, method: Method, state: LearnerState, factor: Factor, function: Callable[[Any, Array], Array]
) -> Linearization:
    """`function(w, memory)`, where the memory depends on the parameters too, about their mean."""
    together = sharding.gathered(learner.mesh)

    def at(step: Float[Array, " L"]) -> Array:
        memory = state.memory.mean + state.memory.slope @ step
        return jnp.ravel(function(learner.parameters.tree(together(state.mean + step)), memory)).astype(step.dtype)

    return method.rule(at, factor.factor, Euclidean())


@eqx.filter_jit
def _predicted(learner: Learner, state: LearnerState, x: Any) -> Prediction:
    def value(w: Any, memory: Array) -> Array:
        return learner.objective.prediction(w, memory, x)

    shape = jax.eval_shape(lambda s: value(learner.parameters.tree(s.mean), s.memory.mean), state).shape
    method = learner.objective.predicted_by(learner.method)
    lin = _linearized(learner, method, state, state.uncertainty.factored, value)
    std = norm_rows(jnp.concatenate([lin.slope, lin.bend], axis=1))
    return Prediction(lin.mean.reshape(shape), std.reshape(shape))
