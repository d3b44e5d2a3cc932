"""A model written as affine about a nominal trajectory, and its filter and smoother one instant after the other.

With δ[k] the displacement of x[k] from its nominal value, and independent standard normal ε:

    δ[k] = F[k] δ[k−1] + c[k] + W[k] ε,        r[k] = H[k] δ[k] + V[k] ε.

r[k] is what was measured minus what is measured at the nominal state. Row 0 is the initial belief (F[0] = 0). The other
rows say what any rule of this library finds about any belief (`Linearization`), so that the same two passes serve every
method. `parallel` has them as prefix sums.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from sigmapoint.belief import SquareRoot, covariance
from sigmapoint.carry import around
from sigmapoint.compiled import series
from sigmapoint.conditioning import Conditioned, Joint, condition
from sigmapoint.entering import Entry
from sigmapoint.rules.linearization import Linearization, Rule
from sigmapoint.spaces import Space
from sigmapoint.step import Filter, Info
from sigmapoint.system import measured


class Affine(NamedTuple):
    """One row for each of T instants; see the module."""

    F: Float[Array, "*T n n"]
    c: Float[Array, "*T n"]
    W: Float[Array, "*T n n"]
    H: Float[Array, "*T m n"]
    r: Float[Array, "*T m"]
    V: Float[Array, "*T m m"]
    active: Bool[Array, "*T m"]
    """which elements were measured; H and V are of all"""


def linearized(run: Filter, nominal: SquareRoot, y: Float[Array, "T d"], u: Any) -> Affine:
    """The model about a belief for every instant (`nominal`, with a leading axis T), by the method's rule."""
    rule, space, initial = run.method.rule, run.model.state_space, run.model.initial

    def transition(k: Array, now: SquareRoot, after: Array, u: Any) -> tuple[Array, Array, Array]:
        fs = run.functions(k)
        entry = fs.process.within(fs.f, fs.state_space)
        mean, F, W = _about(rule, entry, now, u, fs.state_space, fs.state_space)
        return F, fs.state_space.residual(mean, after), W

    def measurement(k: Array, now: SquareRoot, y: Array, u: Any) -> tuple[Array, Array, Array, Array]:
        fs = run.functions(k, y.shape)
        entry = fs.observation.within(fs.h, fs.observation_space)
        mean, H, V = _about(rule, entry, now, u, fs.state_space, fs.observation_space)
        active = measured(y, V.shape[0])
        return H, fs.innovation(y, mean, active), V, active

    k = jnp.arange(y.shape[0])
    now, inputs = jax.tree.map(lambda a: a[:-1], (nominal, u))
    moves = jax.vmap(transition)(k[:-1], now, nominal.mean[1:], inputs)
    root = SquareRoot.of(initial.mean, initial.cov.astype(initial.mean.dtype)).factor
    start = (jnp.zeros_like(root), space.residual(initial.mean, nominal.mean[0]), root)
    F, c, W = (jnp.concatenate([a[None], b]) for a, b in zip(start, moves))
    return Affine(F, c, W, *jax.vmap(measurement)(k, nominal, y, u))


def _about(
    rule: Rule, entry: Entry, nominal: SquareRoot, u: Any, inside: Space, outside: Space
) -> tuple[Array, Array, Array]:
    """Value at the nominal belief, slope in the displacement, and a factor of everything else."""
    displaced, factor = around(nominal, entry, u, inside)
    n = nominal.factor.shape[0]
    value = rule.about(displaced, jnp.zeros(factor.shape[0], factor.dtype), factor, outside)
    columns = jnp.concatenate([value.slope[:, n:], value.bend], axis=1)
    return value.mean, value.slope[:, :n], SquareRoot.root(columns, entry.rest)


def filtered(model: Affine) -> SquareRoot:
    """Beliefs about δ, each from the measurements up to its own instant, with a leading axis T."""

    def step(before: SquareRoot, row: Affine) -> tuple[SquareRoot, SquareRoot]:
        ahead, _, given = _updated(before, row)
        belief = SquareRoot.from_root(ahead.mean + given.step[:, 0], given.root)
        return belief, belief

    nothing = SquareRoot(jnp.zeros_like(model.c[0]), jnp.zeros_like(model.W[0]))
    return series.scan(step, nothing, model)[1]


def seen(before: SquareRoot, row: Affine) -> Info:
    """What the measurements of an instant looked like, from the filtered belief about the one before."""
    ahead, innovation, given = _updated(before, row)
    value = _exact(ahead.mean, row.H @ ahead.factor, row.V)
    return Info.of(given, innovation, covariance(value, None), row.active)


def _updated(before: SquareRoot, row: Affine) -> tuple[SquareRoot, Array, Conditioned]:
    mean = row.F @ before.mean + row.c
    ahead = SquareRoot.marginal(_exact(mean, row.F @ before.factor, row.W), None)
    innovation = jnp.where(row.active, row.r - row.H @ ahead.mean, 0.0)
    return ahead, innovation, _given(ahead, row.H, row.V, innovation[:, None], row.active)


def smoothed(model: Affine, beliefs: SquareRoot) -> SquareRoot:
    """Beliefs about δ from all measurements, from the filtered ones."""

    def step(later: SquareRoot, row: tuple[SquareRoot, Affine]) -> tuple[SquareRoot, SquareRoot]:
        now, after = row
        ahead = later.mean - (after.F @ now.mean + after.c)
        every = jnp.ones(ahead.shape, bool)
        difference = jnp.concatenate([ahead[:, None], later.factor], axis=1)
        given = _given(now, after.F, after.W, difference, every)
        columns = jnp.concatenate([given.step[:, 1:], given.root], axis=1)
        belief = SquareRoot.from_root(now.mean + given.step[:, 0], columns)
        return belief, belief

    end = jax.tree.map(lambda a: a[-1], beliefs)
    rows = (jax.tree.map(lambda a: a[:-1], beliefs), jax.tree.map(lambda a: a[1:], model))
    found = series.scan(step, end, rows, reverse=True)[1]
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b[None]]), found, end)


def _exact(mean: Array, slope: Array, residual: Array) -> Linearization:
    return Linearization(mean, slope, residual, jnp.zeros_like(mean), jnp.zeros_like(residual))


def _given(belief: SquareRoot, A: Array, B: Array, difference: Array, active: Array) -> Conditioned:
    """The belief given A δ + B ε."""
    L = belief.factor
    state = _exact(belief.mean, L, L[:, :0])
    value = _exact(jnp.zeros(A.shape[0], A.dtype), A @ L, B)
    return condition(Joint(value, state, None), difference, active, SquareRoot)
