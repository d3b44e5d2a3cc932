"""The result of a filter or smoother."""

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from sigmapoint import checks
from sigmapoint.breakdown import finite_rows, of_series
from sigmapoint.checks import known
from sigmapoint.spaces import Euclidean, Space, same_elements

FIELDS = ("mean", "cov", "std", "innovation", "innovation_cov", "nis")


class Axis(NamedTuple):
    """Names and units of the elements of a vector."""

    names: tuple[str, ...]
    units: tuple[str, ...]


class Labels(eqx.Module):
    """Names and units of states and measurements, and the spaces in which their differences are taken."""

    states: tuple[str, ...] = eqx.field(static=True)
    state_units: tuple[str, ...] = eqx.field(static=True)
    observations: tuple[str, ...] = eqx.field(static=True)
    observation_units: tuple[str, ...] = eqx.field(static=True)
    state_space: Space = eqx.field(static=True, default=Euclidean())
    observation_space: Space = eqx.field(static=True, default=Euclidean())

    @classmethod
    def of(cls, model: Any, measured: int) -> "Labels":
        """The model's own, with `x0, x1, …`, `y0, y1, …` and no units where it has none."""
        for name in ("observation_names", "observation_units"):
            given = getattr(model, name)
            if given is not None and len(given) != measured:
                raise ValueError(
                    f"{name} must be {measured} string(s), one for each column of y, got {given!r}; is y transposed?"
                )
        return cls(
            model.state_names,
            model.state_units,
            model.observation_names or tuple(f"y{i}" for i in range(measured)),
            model.observation_units or ("",) * measured,
            model.state_space,
            model.observation_space,
        )

    def directions(self, n: int) -> Axis:
        """The n elements of an error: the states, or `d0, d1, …` on a manifold of fewer dimensions."""
        return _axis(Axis(self.states, self.state_units), self.state_space, n, "d")

    def innovations(self, m: int) -> Axis:
        """The m elements of an innovation: the measurements, or `e0, e1, …` on a manifold of fewer dimensions."""
        return _axis(Axis(self.observations, self.observation_units), self.observation_space, m, "e")


def _axis(points: Axis, space: Space, size: int, letter: str) -> Axis:
    """Of differences: named as the points where there are as many; without units where those may be others."""
    names = points.names if size == len(points.names) else tuple(f"{letter}{i}" for i in range(size))
    return Axis(names, points.units if same_elements(space) else ("",) * size)


def measured_rows(y: Float[np.ndarray, "T e"], m: int) -> Bool[np.ndarray, "T"]:
    """Rows of which a filter used something: any element, or only whole rows where an innovation has other elements."""
    known = ~np.isnan(y)
    return np.asarray(known.any(1) if y.shape[1] == m else known.all(1))


class Posterior(eqx.Module):
    """Beliefs over a series; what was not kept is None. Under `jax.vmap` every field has a further leading axis.

    Attributes:
        mean, std: estimates and their standard deviations (T, n), in the units of the state.
        cov: their covariances (T, n, n), symmetric and positive semi-definite.
        log_likelihood: natural logarithm of the density of all measurements ().
        innovation: measurement minus its prediction (T, m); NaN where not measured.
        innovation_cov: covariance of the predicted measurement (T, m, m), of all elements, measured or not.
        nis: normalised innovation squared (T,); in a consistent filter chi-squared with as many degrees of freedom as
            elements were measured, and 0 where none was.
        y, u: what went in.
    """

    FIELDS: ClassVar[tuple[str, ...]] = FIELDS
    """what can be kept"""
    ALWAYS: ClassVar[tuple[str, ...]] = ()
    """what is kept beside the log-likelihood in any case"""
    AXES: ClassVar[dict[str, tuple[str, ...]]] = {}
    """of fields that other results do not have, in a table"""

    mean: Float[Array, "*B T d"] | None
    cov: Float[Array, "*B T n n"] | None
    std: Float[Array, "*B T n"] | None
    innovation: Float[Array, "*B T m"] | None
    innovation_cov: Float[Array, "*B T m m"] | None
    nis: Float[Array, "*B T"] | None
    log_likelihood: Float[Array, "*B"]
    y: Float[Array, "*B T e"]
    u: Any
    labels: Labels

    @classmethod
    def selected(cls, keep: Any) -> tuple[str, ...]:
        """A selection of what can be kept, checked; what is kept in any case may be among it."""
        return checks.selection("keep", keep, (*cls.FIELDS, *cls.ALWAYS, "log_likelihood"))

    @classmethod
    def of(cls, model: Any, y: Array, u: Any, kept: dict[str, Any]) -> Any:
        """From what a run kept."""
        fields = {name: kept.get(name) for name in (*cls.FIELDS, *cls.ALWAYS)}
        labels = Labels.of(model, y.shape[-1])
        return cls(**fields, log_likelihood=kept["log_likelihood"], y=y, u=u, labels=labels)

    def breakdown(self, series: int | None = None) -> str | None:
        """What a warning says where estimates or the log-likelihood are not finite; None where they are, or are traced.

        Args:
            series: the number of this result among others.
        """
        if not known(self.log_likelihood):
            return None
        likely, rows = np.isfinite(np.asarray(self.log_likelihood)), finite_rows(self)
        whole = rows.all(-1) if np.ndim(rows) else rows
        if likely.all() and whole.all():
            return None
        what, bad = ("log-likelihood is", ~likely) if not likely.all() else ("estimates are", ~whole)
        return (
            f"the {what} not finite{of_series(bad, series)}: the model gave NaN or infinity, or the filter broke down. "
            "print(sp.diagnose(post)), of one series, says how many samples it lost, and where to look"
        )

    def to_xarray(self, time: Any = None) -> Any:
        """As an `xarray.Dataset` with named states and measurements.

        Args:
            time: instants (T,), numbers or dates; 0, 1, 2, … where not given.

        Raises:
            ValueError: `time` of another length; a batch of results (pick one first).
            ImportError: xarray is not installed (`pip install sigmapoint[cli]`).

        Examples:
            >>> import jax.numpy as jnp, sigmapoint as sp
            >>> model = sp.StateSpaceModel(lambda x, u: x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
            ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)), state_names=("level",))
            >>> sp.filter(model, jnp.ones((5, 1))).to_xarray().state.values.tolist()
            ['level']
        """
        from sigmapoint.tables import to_xarray

        return to_xarray(self, time)

    def to_frame(self, time: Any = None) -> Any:
        """As a `pandas.DataFrame`, one row an instant, with named columns and their units in `attrs["units"]`.

        Args:
            time: instants (T,), numbers or dates; 0, 1, 2, … where not given.

        Raises:
            ValueError: `time` of another length; a batch of results (pick one first).
            ImportError: pandas is not installed (`pip install sigmapoint[cli]`).

        Examples:
            >>> import jax.numpy as jnp, sigmapoint as sp
            >>> model = sp.StateSpaceModel(lambda x, u: x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
            ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)), state_names=("level",))
            >>> list(sp.filter(model, jnp.ones((5, 1)), keep=("mean", "std")).to_frame().columns)
            ['level', 'level std', 'y0 measured']
        """
        from sigmapoint.tables import to_frame

        return to_frame(self, time)

    def __str__(self) -> str:
        """A few lines for people; the fields as they are inside `jax.jit`, of a batch, or where some were not kept."""
        from sigmapoint.printing import as_lines

        shown = (self.mean, self.std, self.innovation, self.nis, self.log_likelihood)
        whole = all(isinstance(value, jax.Array | np.ndarray) and known(value) for value in shown)
        return as_lines(self) if whole and not np.ndim(self.log_likelihood) else repr(self)

    def contents(self) -> Any:
        """What a page about it shows (`sigmapoint.contents`)."""
        from sigmapoint.contents import Contents

        return Contents({"": self})

    def plot(self, time: Any = None, truth: Any = None) -> Any:
        """Draw each state with its ±2σ band; returns the matplotlib axes.

        Args:
            time: instants (T,), for the horizontal axis.
            truth: true states (T, n), drawn as lines.
        """
        from sigmapoint.plotting import plot_states

        return plot_states(self, time, truth)


def field(post: Posterior, name: str) -> np.ndarray:
    """One field of the result of one series, as a NumPy array.

    Raises:
        ValueError: a batch of results, or a field that was not kept.
    """
    check_single(post)
    value = getattr(post, name)
    if value is None:
        raise ValueError(f"this result has no {name}: call sp.filter with keep=({name!r}, ...), or without keep")
    return host(value)


def check_single(post: Posterior) -> None:
    """Raise where the result is a batch."""
    if np.ndim(post.log_likelihood):
        shape = np.shape(post.log_likelihood)
        raise ValueError(f"this result is a batch of shape {shape}; pick one with jax.tree.map(lambda a: a[i], post)")


def host(value: Any) -> np.ndarray:
    """A NumPy array, from whatever device."""
    return np.asarray(jax.device_get(value))


def input_columns(u: Any, T: int) -> dict[str, Float[np.ndarray, "T"]]:
    """Every numeric column of the inputs by name: `current`, `u0`, `wheel.left`."""
    found: dict[str, np.ndarray] = {}
    for path, leaf in jax.tree_util.tree_leaves_with_path(u):
        values = host(leaf)
        if values.shape[:1] != (T,) or values.dtype.kind not in "fiub":
            continue
        name = jax.tree_util.keystr(path, simple=True, separator=".") or "u"
        flat = values.reshape(T, -1).astype(float)
        labels = [name] if values.ndim == 1 else [f"{name}{i}" for i in range(flat.shape[1])]
        found.update(zip(labels, flat.T))
    return found
