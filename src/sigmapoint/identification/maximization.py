"""The model under which what smoothed beliefs expect is the most likely: the M-step of expectation-maximisation.

With W = Σ E[w wᵀ] over N transitions, V and M likewise for measurements and first states, the expected log-density is

    −½ (N log|Q| + tr Q⁻¹ W) − ½ (N' log|R| + tr R⁻¹ V) − ½ (log|P₀| + tr P₀⁻¹ M)

and so Q = W / N, R = V / N', P₀ = M, each in its structure; parameters, on which W, V and M depend, by gradient before.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint.belief import symmetric
from sigmapoint.compiled.series import of_each
from sigmapoint.identification import expectation
from sigmapoint.identification.expectation import Moments, Smoothed
from sigmapoint.identification.structures import Structure
from sigmapoint.identification.unknowns import Unknowns, built
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel
from sigmapoint.noise import Additive, Gaussian
from sigmapoint.step import Filter

SEARCH = 30
"""Evaluations in a search for parameters: the next step goes on."""
LEAST = 1e-9
"""Variance in directions without noise, relative to the largest: parameters cannot move what is exact."""


class Found(NamedTuple):
    """All that is estimated; nothing in place of what is not."""

    z: Float[Array, " L"] | None
    process: Float[Array, "n n"] | None
    observation: Float[Array, "m m"] | None
    initial: Gaussian | None


class Problem(eqx.Module):
    """What is known, and how the rest is sought."""

    build: Callable[[Any], StateSpaceModel]
    unknowns: Unknowns | None
    method: Method = eqx.field(static=True)
    process: Structure | None = eqx.field(static=True)
    observation: Structure | None = eqx.field(static=True)
    initial: Structure | None = eqx.field(static=True)

    def model(self, found: Found) -> StateSpaceModel:
        """The model as found so far."""
        model = built(self.build, self.theta(found))
        if found.process is not None:
            model = eqx.tree_at(lambda m: m.process_noise, model, _with(model.process_noise, found.process))
        if found.observation is not None:
            model = eqx.tree_at(lambda m: m.observation_noise, model, _with(model.observation_noise, found.observation))
        return model if found.initial is None else eqx.tree_at(lambda m: m.initial, model, found.initial)

    def theta(self, found: Found) -> Any:
        """The parameters, as a pytree; nothing where there are none."""
        return None if self.unknowns is None or found.z is None else self.unknowns.tree(found.z)


class Constant(eqx.Module):
    """A model without parameters."""

    model: StateSpaceModel

    def __call__(self, theta: Any) -> StateSpaceModel:
        return self.model


def _with(noise: Any, cov: Array) -> Additive:
    return eqx.tree_at(lambda n: n.cov, noise, cov)


@eqx.filter_jit
def maximized(problem: Problem, found: Found, y: Array, u: Any, real: Array) -> tuple[Found, Float[Array, ""]]:
    """The model after a step, and the log-likelihood of the one before."""
    model = problem.model(found)
    run = Filter.of(model, problem.method)
    s, log_likelihood = of_each(lambda y, u, real: expectation.smoothed(run, y, u, real), y, u, real)
    if problem.unknowns is not None:
        found = found._replace(z=_parameters(problem, problem.unknowns, found, s))
    run = Filter.of(problem.model(found), problem.method)
    if problem.process is not None:
        # A series of one row has no transition.
        w = jax.vmap(partial(expectation.of_transitions, run))(s).summed if y.shape[1] > 1 else None
        found = found if w is None else found._replace(process=_learned(problem.process, w, found.process))
    if problem.observation is not None:
        R = run.model.observation_noise.cov
        v = jax.vmap(partial(expectation.of_measurements, run, R=R))(s).summed
        found = found._replace(observation=_learned(problem.observation, v, found.observation))
    if problem.initial is not None:
        found = found._replace(initial=_initial(problem.initial, model, s))
    return found, log_likelihood.sum()


def _learned(structure: Structure, moments: Moments, before: Any) -> Float[Array, "n n"]:
    """The covariance, as before where nothing was seen."""
    mean = symmetric(moments.total) / jnp.maximum(moments.number, 1.0)
    return jnp.where(moments.number > 0, symmetric(structure(mean)), before)


def _initial(structure: Structure, model: StateSpaceModel, s: Smoothed) -> Gaussian:
    """Mean and covariance of the first states of all series."""
    space, before = model.state_space, model.initial
    steps = jax.vmap(lambda mean: space.residual(mean, before.mean))(s.mean[:, 0])
    mean = steps.mean(0)
    L = s.factor[:, 0]
    cov = (L @ L.mT).mean(0) + (steps - mean[None]).T @ (steps - mean[None]) / steps.shape[0]
    return Gaussian(space.retract(before.mean, mean), symmetric(structure(symmetric(cov))))


def _parameters(problem: Problem, unknowns: Unknowns, found: Found, s: Smoothed) -> Float[Array, " L"]:
    from sigmapoint.identification.search import bfgs

    start: Any = found.z
    scale = jnp.sqrt(jnp.diagonal(unknowns.prior.cov))
    now = problem.model(found)

    def cost(step: Array) -> Array:
        z = start + scale * step.astype(scale.dtype)
        return _cost(problem.model(found._replace(z=z)), now, problem, s)

    count = jnp.sum(s.real, dtype=s.mean.dtype)
    return start + scale * bfgs(cost, jnp.zeros(scale.shape, s.mean.dtype), count, SEARCH)[0].astype(scale.dtype)


def _cost(model: StateSpaceModel, now: StateSpaceModel, problem: Problem, s: Smoothed) -> Float[Array, ""]:
    """The negative expected log-density."""
    run, process, observation = Filter.of(model, problem.method), model.process_noise, model.observation_noise
    steps = jax.vmap(lambda mean: model.state_space.residual(mean, model.initial.mean))(s.mean[:, 0])
    L = s.factor[:, 0]
    M = Moments((L @ L.mT).sum(0) + steps.T @ steps, jnp.asarray(steps.shape[0], steps.dtype))
    v = jax.vmap(partial(expectation.of_measurements, run, R=now.observation_noise.cov))(s)
    total = _surprise(model.initial.cov, M) + _surprise(observation.cov, v)
    if s.y.shape[1] > 1:
        total += _surprise(process.cov, jax.vmap(partial(expectation.of_transitions, run))(s))
    return jnp.where(jnp.isfinite(total), total, jnp.inf)


def _surprise(cov: Float[Array, "*T n n"], moments: Moments) -> Float[Array, ""]:
    """Of all moments; by the covariance of its instant where that changes."""
    if cov.ndim == 2:
        return _surprise_of_one(cov, moments.summed)
    rows = moments.number.shape[1]
    return jax.vmap(_surprise_of_one)(cov[:rows], jax.tree.map(lambda a: a.sum(0), moments)).sum()


def _surprise_of_one(cov: Float[Array, "n n"], moments: Moments) -> Float[Array, ""]:
    cov = cov.astype(moments.total.dtype)
    variance = jnp.diagonal(cov)
    L = jnp.linalg.cholesky(cov + LEAST * jnp.diag(jnp.where(variance > 0, variance, jnp.max(variance))))
    white = jax.scipy.linalg.solve_triangular(L, moments.total, lower=True)
    square = jnp.trace(jax.scipy.linalg.solve_triangular(L, white.T, lower=True))
    return square / 2 + moments.number * jnp.sum(jnp.log(jnp.diagonal(L)))
