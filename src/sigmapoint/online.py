"""One sample at a time: the same arithmetic as `filter`, in whatever order measurements arrive."""

from typing import Any

import equinox as eqx

from sigmapoint import checks
from sigmapoint.blackbox import unwrapped
from sigmapoint.filtering import Filter, FilterState, Info, fitting
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel


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

    def __init__(self, model: StateSpaceModel, method: Method):
        self._model = model
        self._method = method

    def init(self) -> FilterState:
        """The initial state, at instant 0.

        Returns:
            The belief `model.initial`, as the method holds it.

        Examples:
            >>> import jax.numpy as jnp, sigmapoint as sp
            >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
            ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
            >>> int(sp.online(model).init().step)
            0
        """
        return _init(self._model, self._method)

    def update(self, state: FilterState, y: Any, u: Any = None) -> tuple[FilterState, Info]:
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
        y, u = self._row(state, y, u)
        return unwrapped(_update, self._model, self._method, state, y, u)

    def predict(self, state: FilterState, u: Any = None) -> FilterState:
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
        _, u = self._row(state, (), u)
        return unwrapped(_predict, self._model, self._method, state, u)

    def _row(self, state: FilterState, y: Any, u: Any) -> tuple[Any, Any]:
        if not isinstance(state, FilterState):
            raise ValueError(f"state must come from init(), update() or predict(), got {type(state).__name__}")
        dtype = self._model.initial.mean.dtype
        y = checks.array("y", y).astype(dtype)
        if y.ndim != 1:
            raise ValueError(f"y must be one measurement of shape (m,), got shape {y.shape}")
        checks.measured(y)
        return y, checks.inputs(u, None, dtype)


def online(model: StateSpaceModel, method: Method | None = None) -> OnlineFilter:
    """A filter for live data: `init`, then `update` and `predict` in any order and number.

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


@eqx.filter_jit
def _init(model: StateSpaceModel, method: Method) -> FilterState:
    return Filter.of(model, method).init()


@eqx.filter_jit
def _update(model: StateSpaceModel, method: Method, state: FilterState, y: Any, u: Any) -> tuple[FilterState, Info]:
    return Filter.of(model, method).update(state, y, u)


@eqx.filter_jit
def _predict(model: StateSpaceModel, method: Method, state: FilterState, u: Any) -> FilterState:
    return Filter.of(model, method).predict(state, u)
