"""Smoothing: each state from all measurements, past and future.

Rauch, Tung & Striebel (1965) for the linear case; Särkkä (2008) for sigma points: going back from the end, the
transition is reversed about the filtered belief (`reversal`), and the smoothed x[k+1] is put in: with the gain G, and
B Bᵀ the covariance of x[k] given x[k+1], P_s = G P_s⁺ Gᵀ + B Bᵀ.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from sigmapoint import checks, series
from sigmapoint.belief import Belief
from sigmapoint.blackbox import unwrapped
from sigmapoint.filtering import Estimator, estimate, fields, prepared, scan
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel
from sigmapoint.results import FIELDS, Posterior
from sigmapoint.reversal import Reversal
from sigmapoint.step import Filter, FilterState, Info

MAKERS = "sp.rts(), sp.two_filter(), sp.fixed_lag() or sp.ipls()"


class Smoother(Estimator):
    """An estimator that looks back."""


@dataclass(frozen=True)
class RTS(Smoother):
    """Rauch-Tung-Striebel: filter forward, then reverse each transition."""

    def __call__(
        self, run: Filter, y: Array, u: Any, keep: tuple[str, ...], real: Array | None = None
    ) -> dict[str, Array]:
        def out(state: FilterState, info: Info) -> Any:
            return state, fields(keep, info)

        (states, info), log_likelihood, ahead = scan(run, y, u, out, real)

        def step(later: Belief, row: tuple[FilterState, Any]) -> tuple[Belief, dict[str, Array]]:
            belief = Reversal.of(run, *row).belief(run.model.state_space, later)
            return belief, fields(keep, belief)

        if real is not None:  # to look back on the last row from its own prediction changes nothing
            smoothed = series.scan(step, ahead.belief, (states, u), real=real, reverse=True)[1]
            return {**smoothed, **info, "log_likelihood": log_likelihood}
        end = jax.tree.map(lambda a: a[-1], states.belief)
        before = jax.tree.map(lambda a: a[:-1], (states, u))
        smoothed, last = series.scan(step, end, before, reverse=True)[1], fields(keep, end)
        smoothed = {name: jnp.concatenate([smoothed[name], last[name][None]]) for name in smoothed}
        return {**smoothed, **info, "log_likelihood": log_likelihood}


def rts() -> RTS:
    """The Rauch-Tung-Striebel smoother: backward, from what every transition was (Särkkä 2008).

    Examples:
        >>> import sigmapoint as sp
        >>> sp.rts()
        RTS()
    """
    return RTS()


def smooth(
    model: StateSpaceModel,
    y: Any,
    u: Any = None,
    method: Method | None = None,
    *,
    smoother: Smoother | None = None,
    keep: tuple[str, ...] = FIELDS,
) -> Posterior:
    """Estimate the states of a model from measurements, each from all of them.

    Args:
        model: the model.
        y: measurements (T, m); NaN where an element was not measured.
        u: inputs, any pytree of arrays with leading axis T, or nothing.
        method: as for `filter`.
        smoother: how: `rts()`, which is the default, `two_filter()`, `fixed_lag(lag)` or `ipls()`.
        keep: as for `filter`.

    Returns:
        A `Posterior` whose `mean`, `cov`, `std` are smoothed; innovations, NIS and likelihood are those of the filter.

    Raises:
        ValueError: as `filter`; a smoother that is none.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> y = jnp.array([[1.0], [jnp.nan], [0.5]])
        >>> bool((sp.smooth(model, y).std <= sp.filter(model, y).std).all())
        True
    """
    y, u, method = prepared(model, y, u, method)
    smoother = rts() if smoother is None else smoother
    checks.instance("smoother", smoother, Smoother, MAKERS)
    keep = checks.selection("keep", keep, FIELDS)
    kept = unwrapped(estimate, model, y, u, method, smoother, keep)
    return Posterior.of(model, y, u, kept)
