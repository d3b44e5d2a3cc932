"""The iterated posterior-linearisation smoother: linearise about the smoothed beliefs, smooth, and again.

García-Fernández, Svensson & Särkkä, "Iterated posterior linearization smoother" (2017). With the Taylor rule it is the
iterated extended Kalman smoother: Gauss-Newton on the posterior of the whole trajectory (Bell 1994). The model between
two linearisations is affine, so that its smoother may run one instant after the other or parallel in time.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from sigmapoint import affine, checks, parallel
from sigmapoint.affine import Affine
from sigmapoint.belief import SquareRoot
from sigmapoint.carry import Redraw
from sigmapoint.filtering import fields, scan
from sigmapoint.smoothing.smoother import Smoother
from sigmapoint.step import Filter


@dataclass(frozen=True)
class PosteriorLinearization(Smoother):
    """`passes` linearisations about smoothed beliefs, the first about the filtered ones."""

    passes: int
    parallel: bool

    def __call__(
        self, run: Filter, y: Array, u: Any, keep: tuple[str, ...], real: Array | None = None
    ) -> dict[str, Array]:
        if not isinstance(run.method.carry, Redraw):
            raise ValueError("ipls: a method that carries one point set through f and h cannot draw new ones")
        form, space = (parallel if self.parallel else affine), run.model.state_space

        def again(nominal: SquareRoot) -> tuple[Affine, SquareRoot, SquareRoot]:
            model = affine.linearized(run, nominal, y, u)
            filtered = form.filtered(model)
            smoothed = form.smoothed(model, filtered)
            return model, filtered, SquareRoot(jax.vmap(space.retract)(nominal.mean, smoothed.mean), smoothed.factor)

        # (Rows that are not real say nothing, and nothing comes back from behind them.)
        start = scan(run, y, u, lambda state, _: SquareRoot(state.belief.mean, state.belief.factor), real)[0]
        nominal = jax.lax.fori_loop(0, self.passes - 1, lambda _, nominal: again(nominal)[-1], start)
        model, filtered, smoothed = again(nominal)
        before = jax.tree.map(lambda a: jnp.concatenate([jnp.zeros_like(a[:1]), a[:-1]]), filtered)
        info = jax.vmap(affine.seen)(before, model)
        kept = jax.vmap(lambda belief, info: fields(keep, belief, info))(smoothed, info)
        return {**kept, "log_likelihood": jnp.sum(info.log_likelihood)}


def ipls(passes: int = 5, *, parallel: bool = False) -> PosteriorLinearization:
    """The iterated posterior-linearisation smoother (García-Fernández et al. 2017), for `smooth(..., smoother=)`.

    The model is written as affine about the present beliefs, by the method's rule, and smoothed in square-root form;
    the result is what the next pass linearises about. Innovations, NIS and likelihood are those of the last pass's
    affine model. The passes are not damped: where the posterior has more than one mode they may wander.

    Args:
        passes: number of linearisations; the first is about the filtered beliefs.
        parallel: smooth each affine model in O(log T) parallel steps in place of T, with a few times the work: for
            long series on a GPU. The numbers are the same. The first filter runs one instant after the other.

    Raises:
        ValueError: fewer than one pass; in `smooth`, a method that carries its points from f to h.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: jnp.sin(x), lambda x, u: x**2, 0.1 * jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.ones(1), jnp.eye(1)))
        >>> sp.smooth(model, jnp.ones((4, 1)), method=sp.srukf(), smoother=sp.ipls(3)).mean.shape
        (4, 1)
    """
    return PosteriorLinearization(checks.whole("passes", passes, 1), bool(parallel))
