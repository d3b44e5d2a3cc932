"""What smoothed beliefs expect of the noises: the E-step of expectation-maximisation.

For Gaussian noises the expected log-density of states and measurements needs three second moments only,

    E[w wᵀ], w = x[k+1] − f(x[k], u[k]);      E[v vᵀ], v = y[k] − h(x[k], u[k]);      those of x[0],

the first under the smoothed belief about two neighbours together: with the transition reversed (`reversal`),
x[k] = m[k] + G (x[k+1] − m[k+1]) + B ε. All are found by the method's rule, as a filter finds its own: exactly, where
the model is linear.

Source: Shumway & Stoffer (1982) for linear models; Kokkala, Solin & Särkkä (2016) for sigma points.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from sigmapoint.belief import Belief, covariance
from sigmapoint.filtering import scan
from sigmapoint.rules.linearization import Linearization
from sigmapoint.smoothing.reversal import Reversal, back
from sigmapoint.spaces import Euclidean
from sigmapoint.step import Filter
from sigmapoint.system import measured


class Smoothed(NamedTuple):
    """Smoothed beliefs about every state and about every two neighbours, of one series, with what they are from."""

    mean: Float[Array, "T d"]
    factor: Float[Array, "T n n"]
    gain: Float[Array, "T n n"]
    """G from x[k+1] back to x[k]; of no account in the last row"""
    root: Float[Array, "T n n"]
    """B, likewise"""
    y: Float[Array, "T e"]
    u: Any
    real: Bool[Array, "T"]
    """which rows there are"""


class Moments(NamedTuple):
    """Sums of second moments, and of how many: of a row, or over rows and series."""

    total: Float[Array, "*S n n"]
    number: Float[Array, "*S"]

    @classmethod
    def of(cls, each: Float[Array, "T n n"], there: Bool[Array, "T"]) -> "Moments":
        """Of every row."""
        return cls(jnp.where(there[:, None, None], each, 0.0), there.astype(each.dtype))

    @property
    def summed(self) -> "Moments":
        """All together."""
        n = self.total.shape[-1]
        return Moments(self.total.reshape(-1, n, n).sum(0), self.number.sum())


def smoothed(run: Filter, y: Array, u: Any, real: Array) -> tuple[Smoothed, Float[Array, ""]]:
    """The beliefs, and the log-likelihood."""
    states, log_likelihood, _ = scan(run, y, u, lambda state, _: state, real)
    kind, space = run.method.belief, run.model.state_space

    def out(belief: Belief, reversal: Reversal) -> tuple[Array, ...]:
        return belief.mean, belief.factor, reversal.gain, kind.from_root(reversal.mean, reversal.root).factor

    found = back(run, states, u, lambda later, reversal, _: reversal.belief(space, later), out=out, real=real)
    mean, factor, gain, root = found
    return Smoothed(mean, factor, gain, root, y, u, real), log_likelihood


def of_transitions(run: Filter, s: Smoothed) -> Moments:
    """E[w wᵀ] of every transition."""
    space = run.model.state_space

    def one(k: Array, now: Smoothed, then: Array, L: Array) -> Array:
        fs = run.functions(k)
        call = fs.process.within(fs.f, space).call
        n, nothing = L.shape[0], jnp.zeros(0, L.dtype)

        def off(d: Array) -> Array:
            return space.residual(space.retract(then, d[:n]), call(space.retract(now.mean, d[n:]), now.u, nothing))

        factor = jnp.block([[L, jnp.zeros_like(L)], [now.gain @ L, now.root]])
        return _second(run.method.rule(off, factor, Euclidean()))

    T = s.mean.shape[0]
    before = jax.tree.map(lambda a: a[:-1], s)
    return Moments.of(jax.vmap(one)(jnp.arange(T - 1), before, s.mean[1:], s.factor[1:]), s.real[1:])


def of_measurements(run: Filter, s: Smoothed, R: Float[Array, "*T m m"]) -> Moments:
    """E[v vᵀ] of every row; elements that were not measured are what `R`, so far, expects of them."""

    def one(k: Array, mean: Array, L: Array, y: Array, u: Any, R: Array) -> tuple[Array, Array]:
        fs = run.functions(k, y.shape)
        call = fs.observation.within(fs.h, fs.observation_space).call
        active = measured(y, R.shape[0])
        nothing = jnp.zeros(0, mean.dtype)

        def off(d: Array) -> Array:
            return fs.innovation(y, call(fs.state_space.retract(mean, d), u, nothing), active)

        seen = _second(run.method.rule(off, L, Euclidean()))
        return _completed(seen, R, active), active.any()

    T = s.mean.shape[0]
    Rs = jnp.broadcast_to(R, (T, *R.shape[-2:]))
    each, there = jax.vmap(one)(jnp.arange(T), s.mean, s.factor, s.y, s.u, Rs)
    return Moments.of(each, s.real & there)


def _second(lin: Linearization) -> Float[Array, "n n"]:
    return covariance(lin, None) + jnp.outer(lin.mean, lin.mean)


def _completed(seen: Float[Array, "m m"], R: Float[Array, "m m"], active: Bool[Array, " m"]) -> Float[Array, "m m"]:
    """E[v vᵀ] of all elements from that of the measured ones: the others given these are A v, with what is left."""
    both = active[:, None] & active[None, :]
    known = jnp.where(both, R, 0.0) + jnp.diag(jnp.where(active & (jnp.diagonal(R) > 0), 0.0, 1.0))
    A = jnp.linalg.solve(known, jnp.where(active[:, None], R, 0.0)).T
    A = jnp.where(active[:, None], jnp.eye(R.shape[0], dtype=R.dtype), A)
    left = jnp.where(active[:, None] | active[None, :], 0.0, R - A @ jnp.where(active[:, None], R, 0.0))
    return A @ jnp.where(both, seen, 0.0) @ A.T + left
