"""Several methods on one model and one series: error, coverage, innovations, likelihood and time in one table.

Time is measured as a user meets it: the first call compiles, the later ones do not. `us_per_step` is the best warm call
over the number of samples, `compile_s` what the first call took longer (near zero where it had been compiled before).

Normalised innovations are divided by the number of elements that were measured, so that 1 is expected for any number
of sensors: NIS is χ² with as many degrees of freedom (Bar-Shalom, Li & Kirubarajan 2001, section 5.4).
"""

import warnings
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.breakdown import BreakdownWarning, finite_rows
from sigmapoint.checks import data_checks
from sigmapoint.contents import Contents
from sigmapoint.diagnosis.accuracy import errors
from sigmapoint.diagnosis.consistency import surprise
from sigmapoint.filtering import filter, series_of
from sigmapoint.methods import METHODS
from sigmapoint.model import StateSpaceModel
from sigmapoint.recipe import MAKER, Recipe
from sigmapoint.results import Posterior, field
from sigmapoint.smoothing.smoother import smooth as smoothed
from sigmapoint.timing import clocked

Row = dict[str, Any]

STANDARD = ("ekf", "srekf", "ukf", "srukf", "simplex_ukf", "cdkf", "srcdkf", "ckf", "srckf", "ghkf", "srghkf")
"""Methods where none are given."""
MOST_COLUMNS = 6
"""With more states than this, one overall error stands for those of each."""
WORDS = ("method", "note")
WARM_CALLS, WARM_SECONDS = 3, 1.0
"""Warm calls end at whichever comes first; there is at least one."""


class Comparison(NamedTuple):
    """What `compare` returns: one row a method, and the posterior of each that ran."""

    rows: list[Row]
    posteriors: dict[str, Posterior]

    def __str__(self) -> str:
        filled = {name for row in self.rows for name, value in row.items() if value != ""}
        longest = max(self.rows, key=len)
        columns = [name for name in longest if name in filled]
        texts = [[as_text(row.get(name)) for name in columns] for row in self.rows]
        widths = [max(map(len, column)) for column in zip(columns, *texts)]
        left = [name in WORDS for name in columns]
        return "\n".join(_line(cells, widths, left) for cells in (columns, ["-" * w for w in widths], *texts))

    def contents(self) -> Contents:
        """What a page about it shows."""
        return Contents(self.posteriors)

    def to_frame(self) -> Any:
        """The rows as a `pandas.DataFrame` (`pip install sigmapoint[cli]`)."""
        pd = checks.extra("pandas", "to_frame")
        return pd.DataFrame(self.rows).set_index("method")


def as_text(value: Any) -> str:
    """A cell of a table: four significant digits, nothing for what is missing."""
    if isinstance(value, float):
        return "" if np.isnan(value) else f"{value:.4g}"
    return "" if value is None else str(value)


def _line(cells: list[str], widths: list[int], left: list[bool]) -> str:
    return "  ".join(c.ljust(w) if words else c.rjust(w) for c, w, words in zip(cells, widths, left)).rstrip()


def timed(run: Callable[[], Posterior]) -> tuple[Posterior, float, float]:
    """The result of `run`, seconds of a warm call, and how much longer the first call took."""
    post, first = clocked(run)
    warm: list[float] = []
    while len(warm) < WARM_CALLS and sum(warm) < WARM_SECONDS:
        warm.append(clocked(run)[1])
    return post, min(warm), max(first - min(warm), 0.0)


def _error(post: Posterior, truth: Float[np.ndarray, "T d"]) -> Row:
    """Root-mean-square error of each state, and the share of errors within two standard deviations."""
    found = errors(post, truth)
    whole = found.together()
    rms = {f"rmse {state.name}": state.rms for state in found.each() if state.samples}
    return {**(rms if len(rms) <= MOST_COLUMNS else {"rmse": whole.rms}), "coverage_2sigma": whole.within[1]}


def _innovations(post: Posterior) -> Row:
    found = surprise(field(post, "innovation"), field(post, "nis"))
    ess = getattr(post, "ess", None)
    drawn = {} if ess is None else {"ess": float(np.median(ess))}
    return {"nis_per_element": found.per_element, "log_likelihood": float(post.log_likelihood), **drawn}


def _note(post: Posterior) -> str:
    bad = ~(finite_rows(post) & np.isfinite(field(post, "nis")))
    if bad.any():
        return f"not finite from row {int(np.argmax(bad))}"
    return "" if np.isfinite(float(post.log_likelihood)) else "the likelihood is not finite"


def row_of(name: str, run: Callable[[], Posterior], truth: Any) -> tuple[Row, Posterior | None]:
    """Run one method and judge it; where it refuses, a row with its message."""
    try:
        post, warm, compiling = timed(run)
    except ValueError as error:
        return {"method": name, "note": str(error)}, None
    judged = {} if truth is None else _error(post, truth)
    seconds = {"us_per_step": 1e6 * warm / post.y.shape[0], "compile_s": compiling}
    return {"method": name, **judged, **_innovations(post), **seconds, "note": _note(post)}, post


def compare(
    model: StateSpaceModel,
    y: Any,
    u: Any = None,
    methods: Mapping[str, Recipe] | None = None,
    truth: Float[Array, "T d"] | Float[np.ndarray, "T d"] | None = None,
    *,
    key: Array | int | None = None,
    smooth: bool = False,
    each: Callable[[str], None] = lambda name: None,
) -> Comparison:
    """Run several methods on the same series and put them side by side.

    Args:
        model: the model.
        y: measurements (T, m); NaN where an element was not measured.
        u: inputs, any pytree of arrays with leading axis T, or nothing.
        methods: name -> method; the eleven standard ones where not given.
        truth: true states (T, n), in the units of the state; NaN where not known.
        key: `jax.random.key(seed)`, or the seed, for methods that draw.
        smooth: judge smoothed in place of filtered estimates (innovations are the filter's in both cases), by
            the default smoother of each method.
        each: called with the name of each method before it runs, for a progress bar.

    Returns:
        A `Comparison`: `.rows` (dicts), `.posteriors`, `.to_frame()`, and a table when printed. Columns: `rmse` of each
        state [its unit] and `coverage_2sigma` [1] (0.954 expected) with `truth`; `nis_per_element` [1] (1 expected);
        `log_likelihood`; `ess` [1], the median effective sample size of a particle filter; `us_per_step` [µs] warm;
        `compile_s` [s]; `note`: why a method refused, or where it diverged.

    Raises:
        ValueError: measurements, inputs or truth that do not fit the model, no methods, or one that draws without a
            key.

    Examples:
        >>> import jax, jax.numpy as jnp, sigmapoint as sp
        >>> from sigmapoint.comparison import compare
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> x, y = sp.simulate(model, 50, key=jax.random.key(0))
        >>> table = compare(model, y, methods={"ekf": sp.ekf(), "ukf": sp.ukf()}, truth=x)
        >>> [row["method"] for row in table.rows]
        ['ekf', 'ukf']
    """
    y, u = series_of(model, y, u)
    states = None if truth is None else data_checks.truth(truth, (y.shape[0], *model.initial.mean.shape))
    if methods is not None and not isinstance(methods, Mapping):
        raise ValueError(f"methods must be a dict of name to method, got {type(methods).__name__}")
    if methods is not None and not methods:
        raise ValueError("methods is empty: give a dict such as {'ekf': sp.ekf(), 'srcdkf': sp.srcdkf()}")
    chosen = {name: METHODS[name]() for name in STANDARD} if methods is None else methods
    for name, method in chosen.items():
        checks.instance("method", method, Recipe, MAKER)
        try:
            method.random(key)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error
    estimate = smoothed if smooth else filter
    rows, posteriors = [], {}
    for name, method in chosen.items():
        each(name)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", BreakdownWarning)  # its note says so, and from which row on
            row, post = row_of(name, lambda method=method: estimate(model, y, u, method, key=key), states)
        rows.append(row)
        if post is not None:
            posteriors[name] = post
    return Comparison(rows, posteriors)
