"""Parameters as states: `w[k+1] = w[k] + drift`, `d[k] = G(w[k], x[k]) + noise`, one pair (x, d) at a time.

Source: Wan & van der Merwe, "The Unscented Kalman Filter" (2001), Table 7.4.1; van der Merwe & Wan, "The Square-Root
Unscented Kalman Filter for State and Parameter-Estimation" (2001), Algorithm 3.2, without its downdates: `triangular`.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from sigmapoint import checks, data_checks
from sigmapoint.belief import Dense
from sigmapoint.carry import Redraw
from sigmapoint.learning import measurement_noise
from sigmapoint.learning.drift import Drift, fixed
from sigmapoint.learning.measurement_noise import Known, MeasurementNoise, checked
from sigmapoint.learning.uncertainty import Covariance, Factor, Uncertainty
from sigmapoint.linalg import norm_rows, safe_sqrt, solve_lower
from sigmapoint.methods import Method, srcdkf
from sigmapoint.rules.linearization import Linearization, SigmaPointRule
from sigmapoint.spaces import Euclidean
from sigmapoint.step import LOG_2PI


class LearnerState(NamedTuple):
    """What is known about the parameters, all of them in one vector, after so many updates."""

    mean: Float[Array, "*many L"]
    uncertainty: Uncertainty
    drift: Any
    noise: Array
    """of targets: a variance, variances (m,), or a covariance (m, m), in their squared units"""
    step: Int[Array, "*many"]

    @property
    def std(self) -> Float[Array, "*many L"]:
        """Standard deviations, in the units of the parameters."""
        return safe_sqrt(self.uncertainty.variance)

    @property
    def cov(self) -> Float[Array, "*many L L"]:
        """Their covariance."""
        return self.uncertainty.cov

    @property
    def factor(self) -> Float[Array, "*many L L"]:
        """A lower factor of their covariance."""
        return self.uncertainty.factor


class LearnerInfo(NamedTuple):
    """What a target looked like before it was learned from."""

    prediction: Float[Array, " M"]
    """in the units of the target"""
    innovation: Float[Array, " M"]
    """target minus prediction; NaN where there was none"""
    nis: Float[Array, ""]
    """Normalised innovation squared [1], over the elements there were: their number on average if all is right."""
    log_likelihood: Float[Array, ""]
    """Natural logarithm of the predicted density of the target."""


class Prediction(NamedTuple):
    """A function's value with what the parameters leave open."""

    mean: Array
    """in the units of the targets"""
    std: Array
    """standard deviation by the parameters alone, without the noise of targets"""


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

    function: Callable[[Any, Any], Any] = eqx.field(static=True)
    start: Float[Array, " L"]
    std: Float[Array, " L"]
    rest: Any
    unravel: Callable[[Array], Any] = eqx.field(static=True)
    method: Method = eqx.field(static=True)
    drift: Drift = eqx.field(static=True)
    noise: MeasurementNoise = eqx.field(static=True)

    def init(self) -> LearnerState:
        """The state before the first sample.

        Returns:
            The parameters as given, with the prior's standard deviations.

        Examples:
            >>> import sigmapoint as sp
            >>> sp.learner(lambda w, x: w * x, 0.0, noise=1.0, prior_std=2.0).init().std.tolist()
            [2.0]
        """
        # A derivative needs no points, and so no covariance either: the factor alone costs less.
        dense = self.method.belief is Dense and isinstance(self.method.rule, SigmaPointRule)
        uncertainty = (Covariance if dense else Factor).of(self.std)
        noise = jnp.asarray(self.noise.value, self.start.dtype)
        # Copies, so that a state may be given away.
        return LearnerState(
            jnp.array(self.start), uncertainty, self.drift.start(self.std**2), noise, jnp.zeros((), int)
        )

    def params(self, state: LearnerState) -> Any:
        """The parameters, as the pytree they were given in.

        Args:
            state: from `init` or `update`.

        Returns:
            Their means.
        """
        return self._tree(state.mean)

    def std_params(self, state: LearnerState) -> Any:
        """Standard deviations of the parameters, as the pytree they were given in.

        Args:
            state: from `init` or `update`.

        Returns:
            Them, in place of the parameters.
        """
        return self._tree(state.std)

    def update(self, state: LearnerState, x: Any, d: Any) -> tuple[LearnerState, LearnerInfo]:
        """Learn from one pair.

        Args:
            state: from `init` or `update`.
            x: the input, any pytree; `function(params, x)` predicts `d`.
            d: the target, any shape; NaN where it is not known.

        Returns:
            The new state, and what the target looked like.

        Raises:
            ValueError: a target of another shape than the prediction, NaN or infinity in `x`, infinity in `d`.
        """
        checks.unmasked("target", d)
        return self.update_batch(state, jax.tree.map(_alone, x), _alone(d))

    def update_batch(self, state: LearnerState, x: Any, d: Any) -> tuple[LearnerState, LearnerInfo]:
        """Learn from several pairs at once, as one long target.

        Args:
            state: from `init` or `update`.
            x: inputs, any pytree whose leaves have a leading axis B.
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

        Examples:
            >>> import sigmapoint as sp
            >>> line = sp.learner(lambda w, x: w * x, 2.0, noise=1.0, prior_std=0.5)
            >>> mean, std = line.predict(line.init(), 10.0)
            >>> float(mean), round(float(std), 6)
            (20.0, 5.0)
        """
        return _predicted(self, state, data_checks.inputs(x, None, self.start.dtype, "input"))

    def checked(self, x: Any, d: Any) -> tuple[Any, Any]:
        """Inputs and targets with a leading axis, as arrays."""
        checks.unmasked("targets", d)
        d = d if isinstance(d, np.ndarray) and d.dtype == self.start.dtype else checks.array("targets", d)
        if d.ndim == 0 or d.shape[0] == 0:
            raise ValueError(f"targets must be (B, ...) with B >= 1, got shape {d.shape}")
        if checks.known(d) and bool(np.isinf(d).any()):
            raise ValueError("targets have infinite values; what is not known is NaN")
        x = data_checks.inputs(x, d.shape[0], self.start.dtype, "inputs", "targets")
        return x, d.astype(self.start.dtype)

    def _tree(self, w: Float[Array, " L"]) -> Any:
        return eqx.combine(self.unravel(w), self.rest)

    def values(self, w: Float[Array, " L"], x: Any) -> Float[Array, "B ..."]:
        """Those for several inputs."""
        tree = self._tree(w)
        return jax.vmap(lambda x: jnp.asarray(self.function(tree, x)).astype(w.dtype))(x)

    def fits(self, x: Any, d: Any) -> None:
        """Raise ValueError where the function does not give what is shaped like a target."""
        shape = jax.eval_shape(self.values, self.start, x).shape[1:]
        if shape != d.shape[1:]:
            raise ValueError(f"a target has shape {d.shape[1:]}, but the function gives {shape} for its input")


def learner(
    function: Callable[[Any, Any], Any],
    w0: Any,
    *,
    noise: Any,
    method: Method | None = None,
    drift: Drift | None = None,
    prior_std: Any = 1.0,
) -> Learner:
    """Learn the parameters of a function from pairs of inputs and targets, one at a time, with error bars.

    Args:
        function: `function(w, x)`, the prediction for input `x`, any shape.
        w0: where to start: any pytree of floating-point arrays and numbers (dicts, Equinox modules). Other leaves stay
            as they are.
        noise: how far targets are from a perfect prediction: one variance for all elements of a target, one for each,
            or a covariance (m, m), in squared units of the targets; or `learned_noise(...)`.
        method: `srcdkf()` where not given; its points stay √3 standard deviations out, those of `srukf()` √L. Square
            roots and `ekf` cost O(M L²) for M elements of a target and L parameters, the other dense ones O(L³).
        drift: how much parameters may move between samples; `fixed(0)` where not given.
        prior_std: how far `w0` may be off: a number, or a pytree like `w0`.

    Returns:
        A `Learner`: `init`, `update`, `params`, `predict`.

    Raises:
        ValueError: no parameters, parameters of several types, a noise that is not positive, a negative deviation, a
            method that is iterated or carries points.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> net = sp.learner(lambda w, x: jnp.tanh(w["in"] @ x) @ w["out"],
        ...                  {"in": jnp.ones((3, 2)), "out": jnp.ones(3)}, noise=0.1, drift=sp.forgetting(0.999))
        >>> s, info = net.update(net.init(), jnp.ones(2), 0.5)
        >>> s.mean.shape, info.prediction.shape
        ((9,), (1,))
    """
    if not callable(function):
        raise ValueError(f"function must be a function of (w, x), got {type(function).__name__}")
    method = srcdkf() if method is None else method
    checks.instance("method", method, Method)
    if method.iterations > 1 or not isinstance(method.carry, Redraw):
        raise ValueError("learner: the method must not be iterated, augmented or extended")
    drift = fixed(0.0) if drift is None else drift
    checks.instance("drift", drift, Drift, "sp.fixed(), sp.annealed(), sp.forgetting() or sp.robbins_monro()")
    known = noise if isinstance(noise, MeasurementNoise) else Known(checked("noise", noise))
    w0 = jax.tree.map(
        lambda a: jnp.asarray(a, float) if isinstance(a, int | float) and not isinstance(a, bool) else a, w0
    )
    arrays, rest = eqx.partition(w0, lambda a: eqx.is_inexact_array(a) or isinstance(a, np.ndarray))
    start, unravel = _vector(arrays)
    if isinstance(method.rule, SigmaPointRule):
        checks.digits(abs(method.rule.constants(start.shape[0]).centre), start.dtype)
    return Learner(function, start, _deviations(prior_std, arrays, start), rest, unravel, method, drift, known)


def _vector(arrays: Any) -> tuple[Float[Array, " L"], Callable[[Array], Any]]:
    leaves = jax.tree.leaves(arrays)
    dtypes = {jnp.asarray(a).dtype for a in leaves}
    if not sum(np.size(a) for a in leaves):
        raise ValueError("w0 has no parameters: it must hold at least one array of floating-point numbers")
    if len(dtypes) > 1 or not jnp.issubdtype(next(iter(dtypes)), jnp.floating):
        raise ValueError(f"w0 must be of one floating-point type, got {', '.join(sorted(map(str, dtypes)))}")
    start, unravel = ravel_pytree(arrays)
    checks.finite("w0", start)
    return start, unravel


def _deviations(given: Any, arrays: Any, start: Array) -> Float[Array, " L"]:
    alone = jax.tree.structure(given) == jax.tree.structure(0)
    if not alone and jax.tree.structure(given) != jax.tree.structure(arrays):
        raise ValueError("prior_std must be a number, or a pytree with the structure of w0")
    each = jax.tree.map(lambda a: given, arrays) if alone else given
    try:
        full = jax.tree.map(lambda s, a: jnp.broadcast_to(jnp.asarray(s, start.dtype), jnp.shape(a)), each, arrays)
    except ValueError as error:
        raise ValueError(f"prior_std does not fit w0: {error}") from None
    std = ravel_pytree(full)[0]
    if not bool((jnp.isfinite(std) & (std >= 0)).all()):
        raise ValueError("prior_std must be finite and not negative")
    return std


def _alone(a: Any) -> Any:
    checks.unmasked("input", a)
    return a[None] if isinstance(a, jax.Array) else np.asarray(a)[None]


@eqx.filter_jit
def _updated(learner: Learner, state: LearnerState, x: Any, d: Array) -> tuple[LearnerState, LearnerInfo]:
    return updated(learner, state, x, d)


def updated(learner: Learner, state: LearnerState, x: Any, d: Array) -> tuple[LearnerState, LearnerInfo]:
    """The update, for inputs and targets with a leading axis."""
    learner.fits(x, d)
    targets = d.shape[0]
    cov = measurement_noise.covariance(state.noise, d.size // targets)
    uncertainty = learner.drift.inflated(
        state.uncertainty, learner.drift.added(state.drift, state.uncertainty.variance, state.step)
    )
    factor = uncertainty.factored
    lin = _linearized(learner, state.mean, factor, x)
    there = ~jnp.isnan(jnp.ravel(d))
    R = jnp.kron(jnp.eye(targets, dtype=cov.dtype), cov)
    slope, bend = (jnp.where(there[:, None], part, 0.0) for part in (lin.slope, lin.bend))
    known = jnp.where(there[:, None] & there[None, :], R, 0.0)
    noise = known + bend @ bend.T + jnp.diag(jnp.where(there, 0.0, 1.0))
    innovation = jnp.where(there, jnp.ravel(d) - lin.mean, 0.0)
    learned = factor.updated(slope, noise)
    white = solve_lower(learned.factor, innovation)
    moved = learned.gain.T @ white
    found = measurement_noise.expected(R, white, solve_lower(learned.factor, known))
    m = cov.shape[0]
    found = jnp.einsum("bibj->ij", found.reshape(targets, m, targets, m)) / targets
    after = LearnerState(
        state.mean + moved,
        uncertainty.carried(learned.uncertainty),
        learner.drift.after(state.drift, moved),
        learner.noise.after(state.noise, found),
        state.step + 1,
    )
    nis = jnp.sum(white**2)
    count = jnp.sum(there, dtype=nis.dtype)
    log_density = -0.5 * (nis + count * LOG_2PI) - jnp.sum(jnp.log(jnp.diagonal(learned.factor)))
    return after, LearnerInfo(lin.mean, jnp.where(there, innovation, jnp.nan), nis, log_density)


def _linearized(learner: Learner, mean: Array, factor: Factor, x: Any) -> Linearization:
    """The function of the parameters for these inputs, about their mean."""
    values = learner.values
    return learner.method.rule(lambda step: jnp.ravel(values(mean + step, x)), factor.factor, Euclidean())


@eqx.filter_jit
def _predicted(learner: Learner, state: LearnerState, x: Any) -> Prediction:
    x = jax.tree.map(lambda a: a[None], x)
    shape = jax.eval_shape(learner.values, learner.start, x).shape[1:]
    lin = _linearized(learner, state.mean, state.uncertainty.factored, x)
    std = norm_rows(jnp.concatenate([lin.slope, lin.bend], axis=1))
    return Prediction(lin.mean.reshape(shape), std.reshape(shape))
