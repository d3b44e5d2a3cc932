"""One sample at a time: the same arithmetic as `filter`, in whatever order measurements arrive."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from sigmapoint import checks
from sigmapoint.blackbox import unwrapped
from sigmapoint.checks import data_checks
from sigmapoint.filtering import fitting
from sigmapoint.model import StateSpaceModel
from sigmapoint.online_calls import calls
from sigmapoint.recipe import Recipe


class OnlineFilter:
    """A filter that is fed by hand; made by `online`. It holds no state of its own: states go in and come out.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> live = sp.online(model)
        >>> state, info = live.update(live.init(), [1.0])
        >>> float(state.mean[0]), float(info.innovation[0])
        (0.5, 1.0)
    """

    def __init__(self, model: StateSpaceModel, method: Recipe):
        leaves, structure = jax.tree.flatten(model)
        self._arrays = [leaf for leaf in leaves if _is_array(leaf)]
        rest = tuple(None if _is_array(leaf) else leaf for leaf in leaves)
        self._dtype = np.dtype(model.initial.mean.dtype)
        self._concrete = all(map(checks.known, leaves))
        self._one = jnp.ones((), int)
        self._calls = calls(structure, rest, method)
        self._method = method

    def init(self, key: Array | int | None = None) -> Any:
        """The initial state, at instant 0.

        Args:
            key: `jax.random.key(seed)`, or the seed, for a method that draws: its states carry it on. Of no account to
                the others.

        Returns:
            The belief `model.initial`, as the method holds it.

        Raises:
            ValueError: a method that draws without a key.

        Examples:
            >>> import jax.numpy as jnp, sigmapoint as sp
            >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
            ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
            >>> int(sp.online(model).init().step)
            0
        """
        return self._calls.init(self._arrays, self._method.random(key))

    def update(self, state: Any, y: Any, u: Any = None) -> tuple[Any, Any]:
        """Take in a measurement.

        Args:
            state: from `init`, `update` or `predict`.
            y: the measurement (m,), in the units of the observation function; NaN where an element was not measured.
            u: the input of the same instant, any pytree of arrays, or nothing.

        Returns:
            The new state, at the same instant, and what the measurement looked like (innovation, its covariance, NIS,
            log-density).

        Raises:
            ValueError: a state that is none, a measurement of another shape, infinite values, NaN in `u`.

        Examples:
            >>> import jax.numpy as jnp, sigmapoint as sp
            >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
            ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
            >>> live = sp.online(model)
            >>> state, info = live.update(live.init(), [2.0])
            >>> float(state.mean[0]), float(info.innovation_cov[0, 0])
            (1.0, 2.0)
        """
        given = (self._known(state), self._measurement(y), self._inputs(u))
        return unwrapped(self._calls.update, self._arrays, *given, self._once(*given))

    def predict(self, state: Any, u: Any = None) -> Any:
        """Go on to the next instant.

        Args:
            state: from `init`, `update` or `predict`.
            u: the input of the present instant, any pytree of arrays, or nothing.

        Returns:
            The state one step later.

        Raises:
            ValueError: a state that is none, NaN in `u`.

        Examples:
            >>> import jax.numpy as jnp, sigmapoint as sp
            >>> model = sp.StateSpaceModel(lambda x, u: 2 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
            ...                            sp.Gaussian(jnp.ones(1), jnp.eye(1)))
            >>> live = sp.online(model)
            >>> state = live.predict(live.init())
            >>> float(state.mean[0]), int(state.step)
            (2.0, 1)
        """
        given = (self._known(state), self._inputs(u))
        return unwrapped(self._calls.predict, self._arrays, *given, self._once(*given))

    def step(self, state: Any, y: Any, u: Any = None) -> tuple[Any, Any, Any]:
        """Take in a measurement and go on to the next instant: `update`, then `predict`, in one call.

        A call costs more than the arithmetic of a small model, so one is faster than two.

        Args:
            state: about the instant of `y`: the `ahead` of the step before, or from `init` or `predict`.
            y: the measurement (m,), as for `update`.
            u: the input of the same instant, any pytree of arrays, or nothing.

        Returns:
            The state given the measurement, what the measurement looked like, and the state ahead, at the next instant.

        Raises:
            ValueError: as `update`.

        Examples:
            >>> import jax.numpy as jnp, sigmapoint as sp
            >>> model = sp.StateSpaceModel(lambda x, u: 2 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
            ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
            >>> live = sp.online(model)
            >>> ahead = live.init()
            >>> for y in ([2.0], [4.0]):
            ...     state, info, ahead = live.step(ahead, y)
            >>> int(state.step), int(ahead.step), bool(ahead.mean[0] == 2 * state.mean[0])
            (1, 2, True)
        """
        given = (self._known(state), self._measurement(y), self._inputs(u))
        return unwrapped(self._calls.step, self._arrays, *given, self._once(*given))

    def prepare(self, y: Any, u: Any = None, *, key: Array | int | None = None) -> Any:
        """Compile `update`, `predict` and `step` ahead of the first sample.

        Args:
            y: a measurement (m,) of the shape and type of those to come; its values are of no account.
            u: an input of the shape and type of those to come, or nothing.
            key: as for `init`.

        Returns:
            The initial state, as `init`.

        Raises:
            ValueError: as `update`.

        Examples:
            >>> import jax.numpy as jnp, numpy as np, sigmapoint as sp
            >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
            ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
            >>> int(sp.online(model).prepare(np.zeros(1)).step)
            0
        """
        state = self.init(key)
        self.predict(self.update(state, y, u)[0], u)
        self.step(state, y, u)
        return state

    def _known(self, state: Any) -> Any:
        if not isinstance(state, self._method.state):
            raise ValueError(f"state must come from init(), update() or predict(), got {type(state).__name__}")
        return state

    def _measurement(self, y: Any) -> Any:
        if type(y) is not np.ndarray or y.dtype != self._dtype:
            y = checks.array("y", y).astype(self._dtype)
        if y.ndim != 1:
            hint = "; for a single number pass [y]" if y.ndim == 0 else ""
            raise ValueError(f"y must be one measurement of shape (m,), got shape {y.shape}{hint}")
        data_checks.measured(y)
        return y

    def _inputs(self, u: Any) -> Any:
        return u if u is None else data_checks.inputs(u, None, self._dtype)

    def _once(self, *given: Any) -> Array | None:
        # A loop has no derivative backward, and under a transformation of the user's own there is no hurry.
        known = self._concrete and all(map(checks.known, jax.tree.leaves(given)))
        return self._one if known else None


def _is_array(leaf: Any) -> bool:
    return isinstance(leaf, jax.Array | np.ndarray)


def online(model: StateSpaceModel, method: Recipe | None = None) -> OnlineFilter:
    """A filter for live data: `init`, then `update` and `predict` in any order and number, or `step` for both.

    Args:
        model: the model. A time-varying noise is looked up by the state's `step`; past its end the last one holds.
        method: as for `filter`.

    Returns:
        An `OnlineFilter`; its first calls compile, later ones take as long as the arithmetic.

    Raises:
        ValueError: not a model or a method; an initial angle wider than the points can be.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> live = sp.online(model, sp.ukf())
        >>> s = live.init()
        >>> s, info = live.update(s, [1.0])
        >>> s = live.predict(s)
        >>> s.mean.shape, s.cov.shape, s.std.shape
        ((1,), (1, 1), (1,))
    """
    return OnlineFilter(model, fitting(model, method))
