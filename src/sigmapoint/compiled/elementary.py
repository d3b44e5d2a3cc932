"""Sine, cosine and the angle of a vector in a form that vectorises.

In 64 bits XLA asks the C library for one number after another. Here they are polynomials after a reduction of the
argument, which compute as many at once as the processor does, to within two units in the last place. Where an argument
is too large or too small for the reduction, all of that call are left to the C library.

Reduction to ±π/4 in four parts and the polynomials of sine and cosine: fdlibm (Sun Microsystems 1993), e_rem_pio2.c,
k_sin.c, k_cos.c. Arctangent: a rational function on ±tan(π/8) (Moshier 1989, Cephes, atan.c).
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend import core
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, Bool

QUARTER = (
    1.57079632673412561417e00,
    6.07710050630396597660e-11,
    2.02226624871116645580e-21,
    8.47842766036889956997e-32,
)
"""π/2 in parts; all but the last have 33 bits, so that their multiples are exact."""
LARGEST_ANGLE = 2.0**20
SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)
ARCTANGENT = (
    (
        -6.485021904942025371773e01,
        -1.228866684490136173410e02,
        -7.500855792314704667340e01,
        -1.615753718733365076637e01,
        -8.750608600031904122785e-01,
    ),
    (
        1.945506571482613964425e02,
        4.853903996359136964868e02,
        4.328810604912902668951e02,
        1.650270098316988542046e02,
        2.485846490142306297962e01,
        1.0,
    ),
)
LOW = 6.123233995736765886130e-17
"""What π/2 is more than its nearest number."""
MODERATE = (1e-290, 1e290)
"""Lengths of a vector whose sums and quotients neither overflow nor lose digits."""


def polynomial(z: Array, coefficients: Sequence[float]) -> Array:
    """Horner's scheme, lowest power first."""
    value = jnp.full_like(z, coefficients[-1])
    for c in coefficients[-2::-1]:
        value = value * z + c
    return value


def _negative(x: Array) -> Bool[Array, "..."]:
    """Whether the sign is set, that of zero as well."""
    return lax.bitcast_convert_type(x, np.int64) < 0


def _circular(x: Array, turned: float) -> Array:
    """The sine of `x` and `turned` quarter turns."""
    k = lax.round(x * (2 / np.pi), lax.RoundingMethod.TO_NEAREST_EVEN)
    r = x
    for part in QUARTER:
        r = r - k * part
    z = r * r
    sine = r + r * z * polynomial(z, SINE)
    half = 0.5 * z
    about = 1.0 - half
    cosine = about + ((1.0 - about) - half + z * z * polynomial(z, COSINE))
    quarter = k + turned
    quarter = quarter - 4.0 * jnp.floor(quarter * 0.25)
    value = jnp.where((quarter == 1) | (quarter == 3), cosine, sine)
    return jnp.where(quarter >= 2, -value, value)


def _sine(x: Array) -> Array:
    # The sine of zero has its sign.
    return jnp.where(x == 0, x, _circular(x, 0.0))


def _cosine(x: Array) -> Array:
    return _circular(x, 1.0)


def _direction(y: Array, x: Array) -> Array:
    up, along = jnp.abs(y), jnp.abs(x)
    longer, shorter = jnp.maximum(up, along), jnp.minimum(up, along)
    steep = shorter > 0.66 * longer  # then arctan t = π/4 + arctan((t − 1) / (t + 1))
    t = jnp.where(steep, shorter - longer, shorter) / jnp.where(steep, shorter + longer, longer)
    z = t * t
    angle = t + t * z * polynomial(z, ARCTANGENT[0]) / polynomial(z, ARCTANGENT[1])
    angle = jnp.where(steep, angle + 0.5 * LOW + np.pi / 4, angle)
    angle = jnp.where(up > along, (np.pi / 2 - angle) + LOW, angle)
    angle = jnp.where(_negative(x), (np.pi - angle) + 2 * LOW, angle)
    return jnp.where(_negative(y), -angle, angle)


def _turnable(x: Array) -> Array:
    return ~(jnp.abs(x) > LARGEST_ANGLE)


def _moderate(y: Array, x: Array) -> Array:
    longer = jnp.maximum(jnp.abs(y), jnp.abs(x))
    return ~((longer < MODERATE[0]) | (longer > MODERATE[1]))


def _primitive(name: str, exact: Any, fast: Any, within: Any) -> core.Primitive:
    """An elementwise function: on a CPU in 64 bits by `fast`, where all arguments are `within` its reach."""

    def lowered(*x: Array) -> Array:
        if x[0].dtype != np.float64:
            return exact(*x)
        return lax.cond(within(*x).all(), fast, exact, *x)

    primitive = core.Primitive(name)
    primitive.def_impl(jax.jit(primitive.bind))
    primitive.def_abstract_eval(lambda x, *_: x)
    mlir.register_lowering(primitive, mlir.lower_fun(exact, multiple_results=False))
    mlir.register_lowering(primitive, mlir.lower_fun(lowered, multiple_results=False), platform="cpu")
    return primitive


def _together(args: Sequence[Array], axes: Sequence[Any]) -> tuple[Array, int]:
    size = next(a.shape[axis] for a, axis in zip(args, axes) if axis is not None)
    first = (jnp.broadcast_to(a, (size, *a.shape)) if d is None else jnp.moveaxis(a, d, 0) for a, d in zip(args, axes))
    return _direction_p.bind(*first), 0


_sine_p = _primitive("sine", lax.sin, _sine, _turnable)
_cosine_p = _primitive("cosine", lax.cos, _cosine, _turnable)
_direction_p = _primitive("direction", lax.atan2, _direction, _moderate)
ad.defjvp(_sine_p, lambda g, x: g * _cosine_p.bind(x))
ad.defjvp(_cosine_p, lambda g, x: -g * _sine_p.bind(x))
ad.defjvp(
    _direction_p,
    lambda g, y, x: g * (x / (x * x + y * y)),
    lambda g, y, x: g * (-y / (x * x + y * y)),
)
batching.defvectorized(_sine_p)
batching.defvectorized(_cosine_p)
batching.primitive_batchers[_direction_p] = _together


def _arctangent(x: Array) -> Array:
    return _direction_p.bind(x, jnp.ones_like(x))


VECTORISED: dict[core.Primitive, Callable[..., Array]] = {
    core.primitives.sin_p: _sine_p.bind,
    core.primitives.cos_p: _cosine_p.bind,
    core.primitives.atan2_p: _direction_p.bind,
    core.primitives.atan_p: _arctangent,
}
"""What to put in place of JAX's own."""
