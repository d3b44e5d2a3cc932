"""Draws of whole trajectories from the smoothed posterior, back from the end (`reversal`).

Source: Godsill, Doucet & West, "Monte Carlo smoothing for nonlinear time series" (2004), for Gaussian beliefs.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint import checks, series
from sigmapoint.blackbox import unwrapped
from sigmapoint.filtering import prepared, scan
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel
from sigmapoint.native import applied
from sigmapoint.reversal import Reversal
from sigmapoint.step import Filter, FilterState


def trajectories(
    model: StateSpaceModel, y: Any, u: Any = None, method: Method | None = None, *, key: Array | int, draws: int
) -> Float[Array, "draws T d"]:
    """Draw trajectories of the states from what all measurements say of them together.

    Means and covariances of many are those of `smooth`; each moves as the states do, so that anything of a whole
    trajectory (its maximum, when it first crosses a level) has its distribution in them.

    Args:
        model: the model.
        y: measurements (T, m); NaN where an element was not measured.
        u: inputs, any pytree of arrays with leading axis T, or nothing.
        method: as for `filter`.
        key: `jax.random.key(seed)`, or the seed.
        draws: how many.

    Returns:
        The states (draws, T, n), in their units.

    Raises:
        ValueError: as `filter`; a key that is none, fewer draws than one.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> x = sp.trajectories(model, jnp.ones((20, 1)), key=0, draws=100)
        >>> x.shape, round(float(x.max(axis=1).std()), 1) > 0
        ((100, 20, 1), True)
    """
    y, u, method = prepared(model, y, u, method)
    return unwrapped(_drawn, model, y, u, method, checks.key("key", key), checks.whole("draws", draws, 1))


@eqx.filter_jit
def _drawn(
    model: StateSpaceModel, y: Array, u: Any, method: Method, key: Array, draws: int
) -> Float[Array, "draws T d"]:
    run, space = Filter.of(model, method), model.state_space
    states = scan(run, y, u, lambda state, _: state)[0]
    last = jax.tree.map(lambda a: a[-1], states.belief)
    n, dtype = last.factor.shape[0], last.mean.dtype
    for_last, for_others = jax.random.split(key)
    noise = jax.random.normal(for_last, (draws, n), dtype)
    start = jax.vmap(lambda xi: space.retract(last.mean, applied(last.factor, xi)))(noise)

    def step(later: Array, row: tuple[FilterState, Any, Array]) -> tuple[Array, Array]:
        state, u, key = row
        back = Reversal.of(run, state, u)
        noise = jax.random.normal(key, (draws, back.root.shape[1]), dtype)
        earlier = jax.vmap(lambda x, xi: back.point(space, x, xi))(later, noise)
        return earlier, earlier

    before = jax.tree.map(lambda a: a[:-1], (states, u))
    keys = jax.random.split(for_others, y.shape[0] - 1)
    found = series.scan(step, start, (*before, keys), reverse=True)[1] if y.shape[0] > 1 else start[None, :][:0]
    return jnp.moveaxis(jnp.concatenate([found, start[None]]), 0, 1)
