"""Fixed-lag smoothing: each state from the measurements up to a few instants later; live in `online_smoother`.

The transitions of the last instants are kept reversed (`reversal`), and the newest belief is taken back through them.
With a lag as long as the series that is the Rauch-Tung-Striebel smoother. Of particles, their ancestors are looked up
instead (`particles.smoothing`).
"""

from dataclasses import dataclass
from functools import singledispatch
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array

from sigmapoint import checks
from sigmapoint.belief import Belief
from sigmapoint.compiled import series
from sigmapoint.filtering import fields
from sigmapoint.recipe import Recipe, Run
from sigmapoint.smoothing.reversal import Reversal, last_row
from sigmapoint.smoothing.smoother import Smoother, forward
from sigmapoint.step import Filter, Method


@dataclass(frozen=True)
class FixedLag(Smoother):
    """Each state from measurements up to `lag` instants later."""

    lag: int

    kind: ClassVar[Any] = Recipe

    def __call__(
        self, run: Run, y: Array, u: Any, keep: tuple[str, ...], real: Array | None = None
    ) -> dict[str, Array]:
        return lagged(run.method, run, y, u, min(self.lag, y.shape[0] - 1), keep, real)


@singledispatch
def lagged(
    method: Any, run: Any, y: Array, u: Any, lag: int, keep: tuple[str, ...], real: Array | None
) -> dict[str, Array]:
    """What `FixedLag` gives, by the kind of method."""
    raise NotImplementedError(f"fixed_lag for {method}")


@lagged.register(Method)
def _(
    method: Method, run: Filter, y: Array, u: Any, lag: int, keep: tuple[str, ...], real: Array | None
) -> dict[str, Array]:
    states, kept = forward(run, y, u, keep, real)
    back = series.scan(lambda _, row: (None, Reversal.of(run, *row)), None, (states, u))[1]
    T = y.shape[0]
    k, last = jnp.arange(T), last_row(T, real)
    take = jax.vmap(lambda reversal, later: reversal.belief(run.model.state_space, later))

    def step(j: Array, beliefs: Belief) -> Belief:
        at = k + lag - 1 - j
        earlier = take(jax.tree.map(lambda a: a[jnp.clip(at, 0, T - 1)], back), beliefs)
        return jax.tree.map(
            lambda a, b: jnp.where((at < last).reshape(T, *(1,) * (a.ndim - 1)), a, b), earlier, beliefs
        )

    start = jax.tree.map(lambda a: a[jnp.minimum(k + lag, last)], states.belief)
    beliefs = jax.lax.fori_loop(0, lag, step, start)
    return {**jax.vmap(lambda b: fields(keep, b))(beliefs), **kept}


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
