"""One sample at a time: the same arithmetic as `filter`, in whatever order measurements arrive."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from sigmapoint import checks
from sigmapoint.blackbox import unwrapped
from sigmapoint.filtering import Filter, FilterState, Info, fitting
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel


class OnlineFilter:
    """A filter that is fed by hand; made by `online`. It holds no state of its own: states go in and come out."""

    def __init__(self, model: StateSpaceModel, method: Method):
        self._model = model
        self._method = method

    def init(self) -> FilterState:
        """The initial state, at instant 0."""
        return _init(self._model, self._method)

    def update(self, state: FilterState, y: Any, u: Any = None) -> tuple[FilterState, Info]:
        """Take in a measurement `y` (m,), NaN where an element was not measured, with the input of the same instant.

        Returns:
            The new state, and what the measurement looked like (innovation, its covariance, NIS, log-density).

        Raises:
            ValueError: a state that is none, a measurement of another shape, infinite values, NaN in `u`.
        """
        y, u = self._row(state, y, u)
        return unwrapped(_update, self._model, self._method, state, y, u)

    def predict(self, state: FilterState, u: Any = None) -> FilterState:
        """Go on to the next instant, with the input `u` of the present one.

        Raises:
            ValueError: a state that is none, NaN in `u`.
        """
        _, u = self._row(state, (), u)
        return unwrapped(_predict, self._model, self._method, state, u)

    def _row(self, state: FilterState, y: Any, u: Any) -> tuple[Any, Any]:
        if not isinstance(state, FilterState):
            raise ValueError(f"state must come from init(), update() or predict(), got {type(state).__name__}")
        dtype = self._model.initial.mean.dtype
        y = jnp.asarray(y, dtype) if not isinstance(y, jax.Array) else y.astype(dtype)
        if y.ndim != 1:
            raise ValueError(f"y must be one measurement of shape (m,), got shape {y.shape}")
        checks.measured(y)
        return y, checks.inputs(u, None, dtype)


def online(model: StateSpaceModel, method: Method | None = None) -> OnlineFilter:
    """A filter for live data: `init`, then `update` and `predict` in any order and number.

    Args:
        model: the model. A time-varying noise is looked up by the state's `step`; past its end the last one holds.
        method: as for `filter`.

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
