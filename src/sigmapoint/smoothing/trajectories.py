"""Draws of whole trajectories from the smoothed posterior, back from the end (`reversal`).

Source: Godsill, Doucet & West, "Monte Carlo smoothing for nonlinear time series" (2004), here for Gaussian beliefs, and
in `particles.smoothing` for particles.
"""

from functools import singledispatch
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.belief import Belief
from sigmapoint.blackbox import unwrapped
from sigmapoint.compiled.native import applied
from sigmapoint.filtering import prepared, scan
from sigmapoint.model import StateSpaceModel
from sigmapoint.recipe import Recipe
from sigmapoint.smoothing.reversal import Reversal, back
from sigmapoint.step import Filter, FilterState, Method


def trajectories(
    model: StateSpaceModel, y: Any, u: Any = None, method: Recipe | None = None, *, key: Array | int, draws: int
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
        The states (draws, T, d), in their units; d is the length of the model's initial mean.

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
    if not method.smoothers:
        raise ValueError(f"there are no trajectories of {type(method).__name__}: use sp.bootstrap(particles)")
    return unwrapped(drawn, method, model, y, u, checks.key("key", key), checks.whole("draws", draws, 1))


@singledispatch
def drawn(method: Any, model: StateSpaceModel, y: Array, u: Any, key: Array, draws: int) -> Float[Array, "draws T d"]:
    """What `trajectories` gives, by the kind of method."""
    raise NotImplementedError(f"trajectories for {method}")


@drawn.register(Method)
@eqx.filter_jit
def _(method: Method, model: StateSpaceModel, y: Array, u: Any, key: Array, draws: int) -> Float[Array, "draws T d"]:
    run, space = Filter.of(model, method), model.state_space
    states = scan(run, y, u, lambda state, _: state)[0]
    for_last, for_others = jax.random.split(key)

    def noise_of(key: Array, size: int) -> Array:
        return jax.random.normal(key, (draws, size), model.initial.mean.dtype)

    def start(last: Belief) -> Array:
        noise = noise_of(for_last, last.factor.shape[0])
        return jax.vmap(lambda xi: space.retract(last.mean, applied(last.factor, xi)))(noise)

    def step(later: Array, reversal: Reversal, state: FilterState) -> Array:
        noise = noise_of(jax.random.fold_in(for_others, state.step), reversal.root.shape[1])
        return jax.vmap(lambda x, xi: reversal.point(space, x, xi))(later, noise)

    return jnp.moveaxis(back(run, states, u, step, start), 0, 1)
