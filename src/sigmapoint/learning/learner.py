"""Learning the parameters of a function from pairs of inputs and targets, one at a time, with error bars."""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np

from sigmapoint import checks
from sigmapoint.carry import Redraw
from sigmapoint.checks import belief_checks, data_checks
from sigmapoint.learning import measurement_noise, sharding
from sigmapoint.learning.drift import Drift, drift_of
from sigmapoint.learning.measurement_noise import Known, MeasurementNoise
from sigmapoint.learning.objectives import Objective, listed, objective
from sigmapoint.learning.parameters import Parameters
from sigmapoint.learning.state import LearnerInfo, LearnerState, Prediction
from sigmapoint.learning.update import Setup, predicted, updated
from sigmapoint.methods import Method, srcdkf
from sigmapoint.rules.linearization import SigmaPointRule

_updated, _predicted = eqx.filter_jit(updated), eqx.filter_jit(predicted)


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

    setup: Setup

    def init(self) -> LearnerState:
        """The state before the first sample.

        Returns:
            The parameters as given, with the prior's standard deviations.

        Examples:
            >>> import sigmapoint as sp
            >>> sp.learner(lambda w, x: w * x, 0.0, noise=1.0, prior_std=2.0).init().std.tolist()
            [2.0]
        """
        return self.setup.start()

    def params(self, state: LearnerState) -> Any:
        """The parameters, as the pytree they were given in.

        Args:
            state: from `init` or `update`.

        Returns:
            Their means.
        """
        return self.setup.parameters.tree(state.mean)

    def std_params(self, state: LearnerState) -> Any:
        """Standard deviations of the parameters, as the pytree they were given in.

        Args:
            state: from `init` or `update`.

        Returns:
            Them, in place of the parameters.
        """
        return self.setup.parameters.tree(state.std)

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
        return _updated(self.setup, state, *self.setup.checked(x, d))

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
        return _predicted(self.setup, state, data_checks.inputs(x, None, self.setup.parameters.start.dtype, "input"))


def learner(
    function: Callable[[Any, Any], Any] | Objective,
    w0: Any,
    *,
    noise: Any,
    method: Method | None = None,
    drift: Drift | float | None = None,
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
        drift: how much parameters may move between samples; `fixed(0)` where not given, and a number q is `fixed(q)`.
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
    known = noise if isinstance(noise, MeasurementNoise) else Known(measurement_noise.checked("noise", noise))
    parameters = Parameters.of(w0, prior_std)
    method, drift = fitting(parameters, method, drift)
    return Learner(Setup(learned, parameters, method, drift, known, sharding.mesh(devices, parameters.start.shape[0])))


def fitting(
    parameters: Parameters, method: Method | None, drift: Drift | float | None, name: str = "method"
) -> tuple[Method, Drift]:
    """Method and drift, or their defaults, checked together with the parameters."""
    method = srcdkf() if method is None else method
    checks.instance(name, method, Method)
    if method.iterations > 1 or not isinstance(method.carry, Redraw):
        raise ValueError(f"learner: the {name} must not be iterated, augmented or extended")
    if isinstance(method.rule, SigmaPointRule):
        belief_checks.digits(abs(method.rule.constants(parameters.start.shape[0]).centre), parameters.start.dtype)
    return method, drift_of(drift)


def _alone(a: Any) -> Any:
    checks.unmasked("input", a)
    return a[None] if isinstance(a, jax.Array) else np.asarray(a)[None]
