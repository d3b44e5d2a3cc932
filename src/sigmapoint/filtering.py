"""Filtering a series: `update` with y[k] and then `predict` with u[k], from the first row to the last."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.blackbox import unwrapped
from sigmapoint.breakdown import warned
from sigmapoint.checks import data_checks
from sigmapoint.compiled import series
from sigmapoint.methods import Method, gaussian_filter, srcdkf
from sigmapoint.model import StateSpaceModel
from sigmapoint.recipe import MAKER, Recipe, Run
from sigmapoint.results import FIELDS, Labels, Posterior


def filter(
    model: StateSpaceModel,
    y: Any,
    u: Any = None,
    method: Recipe | None = None,
    *,
    key: Array | int | None = None,
    keep: tuple[str, ...] = FIELDS,
) -> Posterior:
    """Estimate the states of a model from measurements, each from those up to its own instant.

    Args:
        model: the model.
        y: measurements (T, m), in the units of the observation function; NaN where an element was not measured.
        u: inputs, any pytree of arrays with leading axis T, or nothing.
        method: how, e.g. `srukf()`, `ekf()`, `bootstrap(1000)`; `srcdkf()` where not given.
        key: `jax.random.key(seed)`, or the seed, for methods that draw; of no account to the others.
        keep: which results to keep, to save memory on long series: a selection of `mean`, `cov`, `std`, `innovation`,
            `innovation_cov`, `nis`; of a particle filter also `particles`, `log_weights`, `ancestors` (of a Gaussian
            sum `mixture`), which are not kept unless named here. The log-likelihood is always kept, and `ess`.

    Returns:
        A `Posterior` of filtered beliefs; of a particle filter a `ParticlePosterior`.

    Raises:
        ValueError: shapes that do not fit, NaN in `u`, infinite measurements, an unknown name in `keep`, a method that
            draws without a key, a model that is none for the method.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> post = sp.filter(model, jnp.array([[1.0], [jnp.nan], [0.5]]), method=sp.ukf())
        >>> post.mean.shape, post.log_likelihood.shape
        ((3, 1), ())
    """
    y, u, recipe = prepared(model, y, u, method)
    keep = recipe.posterior.selected(keep)
    kept = unwrapped(estimate, model, y, u, recipe, recipe.random(key), Forward(), keep)
    return warned(recipe.posterior.of(model, y, u, kept))


def prepared(model: StateSpaceModel, y: Any, u: Any, method: Recipe | None = None) -> tuple[Array, Any, Recipe]:
    """Checked measurements and inputs, and the method or its default."""
    method = fitting(model, method)
    return *series_of(model, y, u), method


def series_of(model: StateSpaceModel, y: Any, u: Any, longest: int | None = None) -> tuple[Array, Any]:
    """Measurements and inputs, checked against the model; `longest` where they hold several series."""
    checks.instance("model", model, StateSpaceModel)
    y, u = data_checks.series(y, u, model.initial.mean.dtype)
    checks.space("observation_space", model.observation_space, y.shape[1])
    Labels.of(model, y.shape[1])
    T = y.shape[0] if longest is None else longest
    data_checks.long_enough(T, process_noise=model.process_noise, observation_noise=model.observation_noise)
    return y, u


def fitting(model: StateSpaceModel, method: Recipe | None) -> Recipe:
    """The method, or its default, checked together with the model."""
    recipe: Recipe = srcdkf() if method is None else method
    checks.instance("model", model, StateSpaceModel)
    checks.instance("method", recipe, Recipe, MAKER)
    recipe.fits(model)
    return recipe


def gaussian(model: StateSpaceModel, method: Recipe | None) -> Method:
    """The same, of what works with Gaussian beliefs only."""
    given = gaussian_filter("method", method, srcdkf())
    fitting(model, given)
    return given


class Estimator(ABC):
    """What a series is worked through by: a filter or a smoother, with its settings."""

    @abstractmethod
    def __call__(self, run: Any, y: Array, u: Any, keep: tuple[str, ...], real: Array | None = None) -> dict[str, Any]:
        """The fields named in `keep`, and the log-likelihood, over a series; of the rows that are `real`, if given."""


@dataclass(frozen=True)
class Forward(Estimator):
    """The filter: each state from the measurements up to its own instant."""

    def __call__(self, run: Run, y: Array, u: Any, keep: tuple[str, ...], real: Array | None = None) -> dict[str, Any]:
        names = (*keep, *run.method.posterior.ALWAYS)
        kept, log_likelihood, _ = scan(run, y, u, lambda state, info: fields(names, info, state), real)
        return {**kept, "log_likelihood": log_likelihood}


@eqx.filter_jit
def estimate(
    model: StateSpaceModel,
    y: Array,
    u: Any,
    method: Recipe,
    key: Array | None,
    estimator: Estimator,
    keep: tuple[str, ...],
) -> dict[str, Any]:
    """One series through an estimator."""
    return estimator(method.ready(model, key), y, u, keep)


def scan(
    run: Run, y: Array, u: Any, out: Callable[[Any, Any], Any], real: Array | None = None
) -> tuple[Any, Float[Array, ""], Any]:
    """Update and predict over a series: what `out(state, info)` keeps, the log-likelihood, and the state ahead.

    Rows that are not `real` fill up: they leave everything as it is.
    """

    def step(carry: tuple[Any, Array], row: tuple[Array, Any]) -> tuple[tuple[Any, Array], Any]:
        state, total = carry
        state, info = run.update(state, *row)
        return (run.predict(state, row[1]), total + info.log_likelihood), out(state, info)

    start = (run.init(), jnp.zeros((), y.dtype))
    (ahead, total), kept = series.scan(step, start, (y, u), real=real)
    return kept, total, ahead


def fields(keep: tuple[str, ...], *sources: Any) -> dict[str, Any]:
    """The fields named in `keep`, each from the first source that has it."""
    found = {name: next((s for s in sources if name in dir(s)), None) for name in keep}
    return {name: getattr(source, name) for name, source in found.items() if source is not None}
