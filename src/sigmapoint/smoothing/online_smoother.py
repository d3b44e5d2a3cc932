"""Fixed-lag smoothing of live data: the transitions of the last instants are kept reversed (`reversal`)."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sigmapoint import checks
from sigmapoint.belief import Belief
from sigmapoint.blackbox import unwrapped
from sigmapoint.checks import data_checks
from sigmapoint.filtering import gaussian
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel
from sigmapoint.online import OnlineFilter
from sigmapoint.smoothing.reversal import Reversal
from sigmapoint.step import Filter, FilterState, Info


class LaggedState(NamedTuple):
    """What an `OnlineSmoother` knows: a filter's state, and the way back from it."""

    filter: FilterState
    back: Reversal
    """of the last transitions, with a leading axis `lag`, the newest last"""
    passed: Int[Array, ""]
    """how many of them there have been, up to `lag`"""

    @property
    def mean(self) -> Float[Array, " d"]:
        """Mean of the newest state, in its units."""
        return self.filter.mean

    @property
    def cov(self) -> Float[Array, "n n"]:
        """Covariance of the newest state, in products of its units."""
        return self.filter.cov

    @property
    def std(self) -> Float[Array, " n"]:
        """Standard deviations of the newest state's elements, in their units."""
        return self.filter.std


class Window(NamedTuple):
    """Beliefs about the last instants, oldest first, each from all measurements so far; NaN before the first one."""

    mean: Float[Array, "w d"]
    cov: Float[Array, "w n n"]
    std: Float[Array, "w n"]


class OnlineSmoother:
    """A filter that is fed by hand and looks back; made by `online_smoother`. States go in and come out."""

    def __init__(self, model: StateSpaceModel, method: Method, lag: int):
        self._filter = OnlineFilter(model, method)
        self._model, self._method, self._lag = model, method, lag

    def init(self) -> LaggedState:
        """The initial state, at instant 0."""
        return _init(self._model, self._method, self._lag)

    def update(self, state: LaggedState, y: Any, u: Any = None) -> tuple[LaggedState, Info]:
        """Take in a measurement; arguments, results and errors as those of `OnlineFilter.update`."""
        checks.instance("state", state, LaggedState, "from init(), update() or predict()")
        after, info = self._filter.update(state.filter, y, u)
        return state._replace(filter=after), info

    def predict(self, state: LaggedState, u: Any = None) -> LaggedState:
        """Go on to the next instant; arguments and errors as those of `OnlineFilter.predict`."""
        checks.instance("state", state, LaggedState, "from init(), update() or predict()")
        u = jax.tree.map(jnp.asarray, data_checks.inputs(u, None, self._model.initial.mean.dtype))
        after = self._filter.predict(state.filter, u)
        return unwrapped(_pushed, self._model, self._method, state, after, u)

    def prepare(self, y: Any, u: Any = None) -> LaggedState:
        """Compile `update`, `predict` and `smoothed` ahead of the first sample; arguments as of `OnlineFilter.prepare`.

        Returns:
            The initial state, as `init`.

        Raises:
            ValueError: as `update`.

        Examples:
            >>> import jax.numpy as jnp, numpy as np, sigmapoint as sp
            >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
            ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
            >>> sp.online_smoother(model, lag=2).prepare(np.zeros(1)).mean.shape
            (1,)
        """
        state = self.init()
        self.smoothed(self.predict(self.update(state, y, u)[0], u))
        return state

    def smoothed(self, state: LaggedState) -> Window:
        """What is known now of the last instants.

        Args:
            state: from `init`, `update` or `predict`.

        Returns:
            `mean` (lag + 1, n), `cov` and `std`, the oldest instant first, the present one last.
        """
        return _window(self._model, state)


def online_smoother(model: StateSpaceModel, lag: int, method: Method | None = None) -> OnlineSmoother:
    """A filter for live data that also tells what it knows now of the last `lag` instants.

    Args:
        model: the model.
        lag: number of instants to look back.
        method: as for `filter`.

    Returns:
        An `OnlineSmoother`: `init`, `update`, `predict` as those of `online`, and `smoothed`.

    Raises:
        ValueError: not a model or a method, a lag below 1.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> live = sp.online_smoother(model, lag=2)
        >>> s = live.init()
        >>> for y in (1.0, 2.0, 3.0):
        ...     s, info = live.update(s, [y])
        ...     window = live.smoothed(s)
        ...     s = live.predict(s)
        >>> window.mean.shape, bool(window.std[0, 0] < 0.8)
        ((3, 1), True)
    """
    return OnlineSmoother(model, gaussian(model, method), checks.whole("lag", lag, 1))


@eqx.filter_jit
def _init(model: StateSpaceModel, method: Method, lag: int) -> LaggedState:
    start = Filter.of(model, method).init()
    n, d, dtype = start.belief.factor.shape[0], start.mean.shape[0], start.mean.dtype
    points, square = jnp.zeros((lag, d), dtype), jnp.zeros((lag, n, n), dtype)
    return LaggedState(start, Reversal(points, points, square, square), jnp.zeros((), int))


@eqx.filter_jit
def _pushed(model: StateSpaceModel, method: Method, state: LaggedState, after: FilterState, u: Any) -> LaggedState:
    newest = Reversal.of(Filter.of(model, method), state.filter, u)
    newest = newest._replace(root=method.belief.from_root(newest.mean, newest.root).factor)
    back = jax.tree.map(lambda a, b: jnp.concatenate([a[1:], b[None]]), state.back, newest)
    return LaggedState(after, back, jnp.minimum(state.passed + 1, back.mean.shape[0]))


@eqx.filter_jit
def _window(model: StateSpaceModel, state: LaggedState) -> Window:
    def step(later: Belief, reversal: Reversal) -> tuple[Belief, Belief]:
        earlier = reversal.belief(model.state_space, later)
        return earlier, earlier

    now = state.filter.belief
    past = jax.lax.scan(step, now, state.back, reverse=True)[1]
    lag = state.back.mean.shape[0]
    there = jnp.arange(lag + 1) >= lag - state.passed

    def shown(earlier: Array, newest: Array) -> Array:
        both = jnp.concatenate([earlier, newest[None]])
        return jnp.where(there.reshape(-1, *(1,) * newest.ndim), both, jnp.nan)

    mean, cov, std = jax.vmap(lambda b: (b.mean, b.cov, b.std))(past)
    return Window(shown(mean, now.mean), shown(cov, now.cov), shown(std, now.std))
