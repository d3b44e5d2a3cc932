"""Smoothing: each state from all measurements, past and future.

Rauch, Tung & Striebel (1965) for the linear case; Särkkä (2008) for sigma points: going back from the end, the
transition is reversed about the filtered belief (`reversal`), and the smoothed x[k+1] is put in: with the gain G, and
B Bᵀ the covariance of x[k] given x[k+1], P_s = G P_s⁺ Gᵀ + B Bᵀ.
"""

from dataclasses import dataclass
from functools import singledispatch
from typing import Any, ClassVar

from jaxtyping import Array

from sigmapoint import checks
from sigmapoint.blackbox import unwrapped
from sigmapoint.breakdown import warned
from sigmapoint.filtering import Estimator, estimate, fields, prepared, scan
from sigmapoint.model import StateSpaceModel
from sigmapoint.recipe import Recipe
from sigmapoint.results import FIELDS, Posterior
from sigmapoint.smoothing.reversal import back
from sigmapoint.step import Filter, FilterState, Info, Method

MAKERS = "sp.rts(), sp.two_filter(), sp.backward_simulation(), sp.fixed_lag() or sp.ipls()"


class Smoother(Estimator):
    """An estimator that looks back."""

    kind: ClassVar[Any] = Method
    """methods that it can look back through"""

    def fits(self, model: StateSpaceModel) -> None:
        """Raise where the model is none for this smoother."""


def looking_back(smoother: Any, method: Recipe, model: StateSpaceModel) -> Smoother:
    """The smoother, or its default, checked together with the method and the model."""
    kind = type(method).__name__
    if not method.smoothers:
        raise ValueError(f"there is no smoother for {kind}: use sp.bootstrap(particles) or a Gaussian filter")
    smoother = default_smoother(method) if smoother is None else smoother
    checks.instance("smoother", smoother, Smoother, MAKERS)
    if not isinstance(method, smoother.kind):
        raise ValueError(f"smoother must be {method.smoothers} for {kind}, got {type(smoother).__name__}")
    smoother.fits(model)
    return smoother


@singledispatch
def default_smoother(method: Any) -> Smoother:
    """The smoother where none is given, by the kind of method."""
    raise NotImplementedError(f"a smoother for {method}")


def forward(
    run: Filter, y: Array, u: Any, keep: tuple[str, ...], real: Array | None
) -> tuple[FilterState, dict[str, Array]]:
    """The states of the filter, and what a smoother leaves as it is: innovations and likelihood."""

    def out(state: FilterState, info: Info) -> Any:
        return state, fields(keep, info)

    (states, info), log_likelihood, _ = scan(run, y, u, out, real)
    return states, {**info, "log_likelihood": log_likelihood}


@dataclass(frozen=True)
class RTS(Smoother):
    """Rauch-Tung-Striebel: filter forward, then reverse each transition."""

    def __call__(
        self, run: Filter, y: Array, u: Any, keep: tuple[str, ...], real: Array | None = None
    ) -> dict[str, Array]:
        states, kept = forward(run, y, u, keep, real)
        space = run.model.state_space
        smoothed = back(
            run,
            states,
            u,
            lambda later, reversal, _: reversal.belief(space, later),
            out=lambda belief, _: fields(keep, belief),
            real=real,
        )
        return {**smoothed, **kept}


def rts() -> RTS:
    """The Rauch-Tung-Striebel smoother: backward, from what every transition was (Särkkä 2008).

    Examples:
        >>> import sigmapoint as sp
        >>> sp.rts()
        RTS()
    """
    return RTS()


@default_smoother.register(Method)
def _(method: Method) -> RTS:
    return rts()


def smooth(
    model: StateSpaceModel,
    y: Any,
    u: Any = None,
    method: Recipe | None = None,
    *,
    key: Array | int | None = None,
    smoother: Smoother | None = None,
    keep: tuple[str, ...] = FIELDS,
) -> Posterior:
    """Estimate the states of a model from measurements, each from all of them.

    Args:
        model: the model.
        y: measurements (T, m); NaN where an element was not measured.
        u: inputs, any pytree of arrays with leading axis T, or nothing.
        method: as for `filter`.
        key: as for `filter`.
        smoother: how: `rts()`, which is the default, `two_filter()`, `fixed_lag(lag)` or `ipls()`; for a particle
            filter `backward_simulation(100)`, which is the default there, or `fixed_lag(lag)`.
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
    y, u, recipe = prepared(model, y, u, method)
    smoother = looking_back(smoother, recipe, model)
    keep = recipe.posterior.selected(keep)
    kept = unwrapped(estimate, model, y, u, recipe, recipe.random(key), smoother, keep)
    return warned(recipe.posterior.of(model, y, u, kept))
