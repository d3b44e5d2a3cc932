"""Fixed-lag smoothing: each state from the measurements up to a few instants later; for live data, and with a delay.

The transitions of the last instants are kept reversed (`reversal`), and the newest belief is taken back through them.
With a lag as long as the series that is the Rauch-Tung-Striebel smoother.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sigmapoint import checks, data_checks, series
from sigmapoint.belief import Belief
from sigmapoint.blackbox import unwrapped
from sigmapoint.filtering import fields, fitting, scan
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel
from sigmapoint.online import OnlineFilter
from sigmapoint.reversal import Reversal
from sigmapoint.smoothing import Smoother
from sigmapoint.step import Filter, FilterState, Info


@dataclass(frozen=True)
class FixedLag(Smoother):
    """Each state from measurements up to `lag` instants later."""

    lag: int

    def __call__(
        self, run: Filter, y: Array, u: Any, keep: tuple[str, ...], real: Array | None = None
    ) -> dict[str, Array]:
        def out(state: FilterState, info: Info) -> Any:
            return state, fields(keep, info)

        (states, info), log_likelihood, _ = scan(run, y, u, out, real)
        back = series.scan(lambda _, row: (None, Reversal.of(run, *row)), None, (states, u))[1]
        T = y.shape[0]
        k, lag = jnp.arange(T), min(self.lag, T - 1)
        last = T - 1 if real is None else jnp.sum(real, dtype=k.dtype) - 1
        take = jax.vmap(lambda reversal, later: reversal.belief(run.model.state_space, later))

        def step(j: Array, beliefs: Belief) -> Belief:
            at = k + lag - 1 - j
            earlier = take(jax.tree.map(lambda a: a[jnp.clip(at, 0, T - 1)], back), beliefs)
            return jax.tree.map(
                lambda a, b: jnp.where((at < last).reshape(T, *(1,) * (a.ndim - 1)), a, b), earlier, beliefs
            )

        start = jax.tree.map(lambda a: a[jnp.minimum(k + lag, last)], states.belief)
        beliefs = jax.lax.fori_loop(0, lag, step, start)
        return {**jax.vmap(lambda b: fields(keep, b))(beliefs), **info, "log_likelihood": log_likelihood}


def fixed_lag(lag: int) -> FixedLag:
    """A smoother that waits: each state from the measurements up to `lag` instants later.

    What `online_smoother` gives live, over a whole series. It costs `lag` times as much as `rts` to look back.

    Args:
        lag: number of instants; 0 is the filter, as many as there are (or more) `rts`.

    Raises:
        ValueError: a negative number.

    Examples:
        >>> import sigmapoint as sp
        >>> sp.fixed_lag(5)
        FixedLag(lag=5)
    """
    return FixedLag(checks.whole("lag", lag, 0))


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
    return OnlineSmoother(model, fitting(model, method), checks.whole("lag", lag, 1))


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
