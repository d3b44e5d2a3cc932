"""What is known of parameters, in their own units, from a belief about z (`unknowns`)."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.identification.unknowns import Unknowns
from sigmapoint.results import Posterior
from sigmapoint.step import FilterState

BAR = 2.0
"""Standard deviations to either end of an interval."""


class Estimates(eqx.Module):
    """What is known of parameters, each field a pytree like them; with a leading axis where that changes with time."""

    value: Any
    """the median, in the parameters' own units"""
    std: Any
    """half the width of the central 68 %: of a Gaussian, its standard deviation"""
    low: Any
    """where the central 95 % (two standard deviations of a Gaussian) begin"""
    high: Any
    """where they end"""

    @classmethod
    def of(cls, unknowns: Unknowns, mean: Float[Array, "*T L"], std: Float[Array, "*T L"]) -> "Estimates":
        """From beliefs about z; where a deviation is NaN, the value alone is known."""
        flat_mean, flat_std = mean.reshape(-1, mean.shape[-1]), std.reshape(-1, std.shape[-1])
        lead = mean.shape[:-1]

        def at(distance: float) -> Any:
            z = flat_mean + distance * flat_std if distance else flat_mean
            found = jax.vmap(unknowns.tree.only)(z)
            return jax.tree.map(lambda a: jnp.reshape(a, (*lead, *jnp.shape(a)[1:])), found)

        half = jax.tree.map(lambda above, below: (above - below) / 2, at(1.0), at(-1.0))
        return cls(*map(unknowns.tree.complete, (at(0.0), half, at(-BAR), at(BAR))))


def estimates(theta: Any, post: Posterior | FilterState) -> Estimates:
    """What a result of `joint` says of the parameters, in their own units.

    Args:
        theta: as given to `joint`.
        post: what `filter`, `smooth` or `batch` made of its model, with `mean` and `std` kept; or a state of `online`.

    Returns:
        `Estimates`: value, standard deviation and a 95 % interval, each a pytree like the parameters; of a series, its
        leaves have a leading axis T.

    Raises:
        ValueError: a result without `mean` and `std`, or of another model than `theta` makes.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> def build(theta):
        ...     return sp.StateSpaceModel(lambda x, u: theta["a"] * x, lambda x, u: x, 0.01 * jnp.eye(1),
        ...                               0.01 * jnp.eye(1), sp.Gaussian(jnp.ones(1), jnp.eye(1)))
        >>> theta = {"a": sp.bounded(0.5, 0.3, low=0.0, high=1.0)}
        >>> post = sp.filter(sp.joint(build, theta), 0.9 ** jnp.arange(50.0)[:, None])
        >>> found = sp.estimates(theta, post)
        >>> bool(found.low["a"][-1] < 0.9 < found.high["a"][-1])
        True
    """
    unknowns = Unknowns.of(theta)
    wanted = "a result of sp.filter or sp.smooth, one of those of sp.batch, or a state of sp.online"
    checks.instance("post", post, Posterior | FilterState, wanted)
    if post.mean is None or post.std is None:
        raise ValueError("estimates: the result has no mean or no std: filter with both among keep=")
    if post.std.shape[-1] < unknowns.size:
        raise ValueError(
            f"estimates: {unknowns.size} parameters in a result of {post.std.shape[-1]} states: is it of sp.joint?"
        )
    names = tuple(f"z.{name}" for name in unknowns.names)
    if isinstance(post, Posterior) and post.labels.states[-unknowns.size :] != names:
        raise ValueError(
            f"theta must be the one that was given to joint: it makes {', '.join(names)} of the last states, and those "
            f"of the result are {', '.join(post.labels.states[-unknowns.size :])}"
        )
    return Estimates.of(unknowns, post.mean[..., -unknowns.size :], post.std[..., -unknowns.size :])
