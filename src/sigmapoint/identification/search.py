"""A minimum from afar and to the last digit: BFGS with short steps, then Newton's method.

    BFGS    s ← s - B⁻¹ g, no longer than a few units, halved until f falls (Armijo)
    Newton  s ← s - H⁻¹ g in the directions in which H says something, while f does not grow

BFGS needs no Hessian where that says little; near the minimum Newton's steps cost one each and square the error. What
is left is measured in standard deviations, √(gᵀ H⁻¹ g).

Source: Nocedal & Wright, "Numerical Optimization" (2006), algorithm 6.1; allowance for round-off: Hager & Zhang, SIAM
J. Optim. 16 (2005) 170, section 4.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from sigmapoint import checks
from sigmapoint.identification.curvature import Curvature

optimistix: Any = checks.extra("optimistix", "fit", "fit")

LONGEST = 3.0
"""Length of a step at most, in prior deviations."""
POLISHES = 12
"""Steps of Newton's method at most."""


class Minimum(NamedTuple):
    """Where a function has come to."""

    s: Float[Array, " L"]
    value: Float[Array, ""]
    gradient: Float[Array, " L"]
    hessian: Float[Array, "L L"]
    steps: Int[Array, ""]


class Short(optimistix.AbstractDescent):
    """A descent whose steps end at `LONGEST`."""

    of: Any = optimistix.NewtonDescent()

    def init(self, y: Any, f_info_struct: Any) -> Any:
        return self.of.init(y, f_info_struct)

    def query(self, y: Any, f_info: Any, state: Any) -> Any:
        return self.of.query(y, f_info, state)

    def step(self, step_size: Any, state: Any) -> Any:
        step, result = self.of.step(1.0, state)
        length = jnp.linalg.norm(step)
        return step * (step_size.astype(step.dtype) * jnp.where(length > LONGEST, LONGEST / length, 1.0)), result


class Allowing(optimistix.AbstractSearch):
    """A line search that takes for equal what differs by round-off: else it would halve its steps for ever."""

    of: Any = optimistix.BacktrackingArmijo()

    def init(self, y: Any, f_info_struct: Any) -> Any:
        return self.of.init(y, f_info_struct)

    def step(self, first_step: Any, y: Any, y_eval: Any, f_info: Any, f_eval_info: Any, state: Any) -> Any:
        lowered = optimistix.FunctionInfo.Eval(f_eval_info.f - round_off(f_eval_info.f))
        return self.of.step(first_step, y, y_eval, f_info, lowered, state)


class ShortBFGS(optimistix.AbstractBFGS):
    """BFGS on the inverse of the Hessian."""

    rtol: float
    atol: float
    norm: Any = optimistix.max_norm
    use_inverse: bool = True
    descent: Any = Short()
    search: Any = Allowing()
    verbose: Any = eqx.field(static=True, default=lambda **what: None)


def round_off(value: Float[Array, ""]) -> Float[Array, ""]:
    """Of a sum of many terms that has this value."""
    return 10 * jnp.finfo(value.dtype).eps * (1 + jnp.abs(value))


def bfgs(
    f: Callable[[Array], Array], start: Float[Array, " L"], count: Any, steps: int
) -> tuple[Float[Array, " L"], Int[Array, ""]]:
    """Close to a minimum of `f`, and how many evaluations that took; `f` is finite at the start."""
    near = float(jnp.finfo(start.dtype).eps ** (1 / 3))
    found = optimistix.minimise(lambda s, _: f(s) / count, ShortBFGS(near, near), start, max_steps=steps, throw=False)
    return found.value, found.stats["num_steps"]


def minimum(f: Callable[[Array], Array], start: Float[Array, " L"], count: Any, steps: int) -> Minimum:
    """A minimum of `f`, with gradient and Hessian.

    Args:
        f: a negative log-density, twice differentiable; +inf with a gradient of zero where it has no value.
        start: where to begin; coordinates are scaled so that one is a long way.
        count: terms of `f`: BFGS begins with steps that suit their mean.
        steps: evaluations of BFGS at most.
    """
    close, taken = bfgs(f, start, count, steps)
    enough = 10 * jnp.sqrt(jnp.finfo(start.dtype).eps)

    def slope(s: Array) -> tuple[Array, tuple[Array, Array]]:
        value, gradient = jax.value_and_grad(f)(s)
        return gradient, (value, gradient)

    def polish(carry: tuple[Minimum, Array, Array]) -> tuple[Minimum, Array, Array]:
        best, candidate, _ = carry
        hessian, (value, gradient) = jax.jacfwd(slope, has_aux=True)(candidate)
        new = Minimum(candidate, value, gradient, hessian, best.steps + 1)
        better = value <= best.value + round_off(value)
        best = jax.tree.map(lambda a, b: jnp.where(better, a, b), new, best)
        curvature = Curvature.of(best.hessian)
        more = better & (curvature.distance(best.gradient) > enough)
        return best, best.s - curvature.solved(best.gradient), more

    def going(carry: tuple[Minimum, Array, Bool[Array, ""]]) -> Array:
        return carry[2] & (carry[0].steps < taken + POLISHES)

    L = start.shape[0]
    nothing = jnp.zeros((L, L), start.dtype)
    begun = Minimum(close, jnp.asarray(jnp.inf, start.dtype), jnp.zeros_like(start), nothing, taken)
    return jax.lax.while_loop(going, polish, (begun, close, jnp.array(True)))[0]
