"""The two-filter smoother: one filter forward, one backward, and the product of what they say.

    1 / P_s = 1 / P_f + 1 / P_b,        x_s = P_s (x_f / P_f + x_b / P_b)

with the filtered belief f about x[k], and the belief b about it from the later measurements alone. Source: Wan & van
der Merwe, "The Unscented Kalman Filter" (2001), equations 7.72 to 7.75, after Fraser & Potter (1969).

* The model linearised: about the filtered beliefs by the method's rule (`affine`). What later measurements say of x[k]
  is kept as information, η and Z Zᵀ, going back by the elements of `parallel`: the dynamics are not inverted, and
  nothing is known after the end.
* A backward model of the user's own (`backward_model`).

The product is `condition` in either case: b is a measurement of the state.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint import affine, checks, parallel
from sigmapoint.affine import Affine
from sigmapoint.belief import Belief, Spread, SquareRoot
from sigmapoint.carry import known
from sigmapoint.compiled import series
from sigmapoint.conditioning import Joint, condition
from sigmapoint.filtering import fields
from sigmapoint.noise import Gaussian, noise_of
from sigmapoint.rules.linearization import Linearization
from sigmapoint.smoothing.backward_model import Backward
from sigmapoint.smoothing.smoother import Smoother, forward
from sigmapoint.step import Filter


class Information(NamedTuple):
    """What later measurements say of a displacement δ: the exponent ηᵀ δ − |Zᵀ δ|² / 2."""

    eta: Float[Array, "*T n"]
    Z: Float[Array, "*T n n"]


@dataclass(frozen=True)
class Linearized(Smoother):
    """Two filters, the second on the model linearised about the beliefs of the first."""

    def __call__(
        self, run: Filter, y: Array, u: Any, keep: tuple[str, ...], real: Array | None = None
    ) -> dict[str, Array]:
        states, kept = forward(run, y, u, keep, real)
        beliefs = states.belief
        model = affine.linearized(run, jax.vmap(lambda b: SquareRoot(b.mean, b.factor))(beliefs), y, u)
        kind, space = run.method.belief, run.model.state_space

        def together(belief: Belief, later: Information) -> dict[str, Array]:
            L = belief.factor
            n = L.shape[0]
            none = jnp.zeros((n, 0), L.dtype)
            value = Linearization(jnp.zeros(n, L.dtype), later.Z.T @ L, none, jnp.zeros(n, L.dtype), none)
            noise = Spread(*(jnp.eye(n, dtype=L.dtype),) * 2)
            nothing = jnp.zeros((n, 1), L.dtype)
            given = condition(Joint(value, known(belief, n), noise), nothing, jnp.ones(n, bool), kind)
            mean = space.retract(belief.mean, given.root @ (given.root.T @ later.eta))
            return fields(keep, kind.from_root(mean, given.root))

        return {**jax.vmap(together)(beliefs, informed(model)), **kept}


def informed(model: Affine) -> Information:
    """What the rows after each say of δ, with a leading axis T."""

    def step(later: Information, row: Affine) -> tuple[Information, Information]:
        here = parallel.element(row)
        both = parallel.after(here, here._replace(eta=later.eta, Z=later.Z))
        return Information(both.eta, both.Z), later

    nothing = Information(jnp.zeros_like(model.c[0]), jnp.zeros_like(model.F[0]))
    return series.scan(step, nothing, model, reverse=True)[1]


def two_filter(
    backward: Callable[..., Any] | None = None, *, noise: Any = None, initial: Gaussian | None = None
) -> Smoother:
    """The two-filter smoother: forward, backward, and both together (Wan & van der Merwe 2001, section 7.3.2).

    Without a backward model the one linearised about the filtered beliefs is used, which for a linear model is exact.
    A backward model of one's own, from first principles or learned (`learn`), is filtered as it is.

    Args:
        backward: `b(x_next, u) -> x`, the state before `x_next`, with the input u[k] that drives x[k] to x[k+1];
            `b(x_next, u, w)` where `noise` is `NonAdditive`.
        noise: how far that is off: a covariance (n, n) or as `process_noise` of a model, in squared units of the state.
        initial: belief about the last state, before its measurement: as wide as nothing is known of it. It counts as if
            measured, and less the longer the series.

    Raises:
        ValueError: a backward model without its noise or initial belief, or these without a model.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> back = sp.two_filter(lambda x, u: x / 0.9, noise=jnp.eye(1) / 0.81,
        ...                      initial=sp.Gaussian(jnp.zeros(1), 1e9 * jnp.eye(1)))
        >>> y = jnp.ones((20, 1))
        >>> same = sp.smooth(model, y, smoother=back).mean - sp.smooth(model, y, smoother=sp.rts()).mean
        >>> bool(jnp.abs(same).max() < 1e-6)
        True
    """
    if backward is None:
        if noise is not None or initial is not None:
            raise ValueError("two_filter: noise and initial are those of a backward model, and there is none")
        return Linearized()
    checks.function("backward", backward, "(x_next, u)")
    if noise is None:
        raise ValueError("two_filter: a backward model needs its noise, a covariance as the process_noise of a model")
    if not isinstance(initial, Gaussian):
        raise ValueError("two_filter: a backward model needs initial=sp.Gaussian(...), a belief about the last state")
    return Backward(backward, noise_of("noise", noise), initial)
