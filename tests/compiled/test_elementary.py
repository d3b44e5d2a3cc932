"""Circular functions that vectorise: to two units in the last place, in every corner."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mpmath import mp

from sigmapoint.compiled import folding
from sigmapoint.compiled.elementary import LARGEST_ANGLE, VECTORISED

SIN, COS, ATAN2, ATAN = VECTORISED.values()
ULPS = 2.0


def _ulps(values, exact):
    """The largest error in units in the last place."""
    worst = 0.0
    for value, true in zip(np.asarray(values), exact):
        worst = max(worst, float(abs(mp.mpf(float(value)) - true) / np.spacing(abs(float(true)))))
    return worst


def _angles():
    r = np.random.default_rng(0)
    near = np.arange(-40, 41) * (np.pi / 4)
    nearest = np.array([642615.9188844458, 321307.9594422229])  # to a multiple of π/2, below 2**20
    far = r.uniform(-LARGEST_ANGLE, LARGEST_ANGLE, 2000)
    return np.concatenate(
        [r.uniform(-7, 7, 2000), near, np.nextafter(near, 9e9), nearest, far, 10.0 ** r.uniform(-300, 0, 500)]
    )


@pytest.mark.parametrize(("ours", "exact"), [(SIN, mp.sin), (COS, mp.cos)])
def test_sine_and_cosine(ours, exact):
    x = _angles()
    with mp.workdps(60):
        assert _ulps(ours(jnp.asarray(x)), [exact(mp.mpf(v)) for v in x.tolist()]) < ULPS


def test_direction_of_a_vector():
    r = np.random.default_rng(1)
    angle, length = r.uniform(-np.pi, np.pi, 3000), 10.0 ** r.uniform(-200, 200, 3000)
    y, x = length * np.sin(angle), length * np.cos(angle)
    y[:300] *= 10.0 ** r.uniform(-80, 0, 300)
    x[300:600] *= 10.0 ** r.uniform(-80, 0, 300)
    with mp.workdps(60):
        exact = [mp.atan2(mp.mpf(a), mp.mpf(b)) for a, b in zip(y.tolist(), x.tolist())]
        assert _ulps(ATAN2(jnp.asarray(y), jnp.asarray(x)), exact) < ULPS
        exact = [mp.atan(mp.mpf(a)) for a in y.tolist()]
        assert _ulps(ATAN(jnp.asarray(y)), exact) < ULPS


SPECIAL = np.array([0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 1e300, -1e300, 1e-300, 3e15, 2.0**20 + 0.5])


@pytest.mark.parametrize("together", [True, False], ids=["together", "one by one"])
def test_zeros_with_their_signs_infinities_and_huge_numbers(together):
    """Together, one that is out of reach sends all to the C library; alone, only itself."""
    y, x = (a.ravel() for a in np.meshgrid(SPECIAL, SPECIAL))
    for ours, theirs, args in ((SIN, np.sin, [SPECIAL]), (COS, np.cos, [SPECIAL]), (ATAN2, np.arctan2, [y, x])):
        with np.errstate(all="ignore"):
            expected = theirs(*args)
        given = [jnp.asarray(a) for a in args]
        found = np.asarray(ours(*given)) if together else np.array([ours(*each) for each in zip(*given)])
        np.testing.assert_allclose(found, expected, rtol=1e-15, atol=np.finfo(float).tiny)  # subnormal is zero to XLA
        real = ~np.isnan(expected)
        np.testing.assert_array_equal(np.signbit(found)[real], np.signbit(expected)[real])


def test_derivatives_of_every_order_and_vmap():
    x, y = jnp.linspace(-3, 3, 7), jnp.linspace(0.5, -2, 7)
    for ours, theirs in ((SIN, jnp.sin), (COS, jnp.cos), (ATAN, jnp.arctan)):
        np.testing.assert_allclose(jax.vmap(jax.grad(ours))(x), jax.vmap(jax.grad(theirs))(x), rtol=1e-14, atol=1e-15)
        second = jax.vmap(jax.hessian(ours))(x), jax.vmap(jax.hessian(theirs))(x)
        np.testing.assert_allclose(*second, rtol=1e-13, atol=1e-15)
    slopes = jax.vmap(jax.jacfwd(lambda v: ATAN2(*v))), jax.vmap(jax.jacrev(lambda v: jnp.arctan2(*v)))
    np.testing.assert_allclose(slopes[0](jnp.stack([y, x], 1)), slopes[1](jnp.stack([y, x], 1)), rtol=1e-14)
    tables = (jax.vmap(jax.vmap(f, (0, None)), (None, 0))(y, x) for f in (ATAN2, jnp.arctan2))
    np.testing.assert_allclose(*tables, rtol=1e-15)


def test_a_users_function_has_them_in_64_bits_only(monkeypatch):
    monkeypatch.setattr(folding, "NATIVE", True)

    def f(x):
        return jnp.stack([jnp.sin(x[0]), jnp.cos(x[1]), jnp.arctan2(x[0], x[1]), jnp.arctan(x[0])])

    x = jnp.array([0.3, -2.0])
    program = str(jax.make_jaxpr(folding.folded(f))(x))
    assert {"sine", "cosine", "direction"} <= set(program.replace("\n", " ").split())
    np.testing.assert_allclose(folding.folded(f)(x), f(x), rtol=1e-15)
    assert "sine" not in str(jax.make_jaxpr(folding.folded(f))(x.astype(jnp.float32))).split()
