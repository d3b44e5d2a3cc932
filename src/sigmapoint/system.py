"""A model made ready for a run: noises factored, functions checked as they are traced."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from sigmapoint.belief import Spread
from sigmapoint.carry import Functions
from sigmapoint.checks import function_checks
from sigmapoint.compiled.folding import folded
from sigmapoint.densities import Density, Normal, whitening
from sigmapoint.distributions import Given
from sigmapoint.entering import NoiseSeries
from sigmapoint.model import StateSpaceModel


class System(NamedTuple):
    """A model and its noises."""

    model: StateSpaceModel
    process: NoiseSeries
    observation: NoiseSeries

    @classmethod
    def of(cls, model: StateSpaceModel) -> "System":
        dtype = model.initial.mean.dtype
        noises = (NoiseSeries.of(n, dtype) for n in (model.process_noise, model.observation_noise))
        return cls(model, *noises)

    def functions(self, k: Array, observed: tuple[int, ...] | None = None) -> Functions:
        """The model at instant `k`; `observed` is the shape that h has to return."""
        model, dtype = self.model, self.model.initial.mean.dtype

        def f(*args: Any) -> Array:
            value = function_checks.called("dynamics", model.dynamics, *args)
            return function_checks.returned("dynamics", value, model.initial.mean.shape, "the next state").astype(dtype)

        def h(*args: Any) -> Array:
            value = function_checks.called("observation", model.observation, *args)
            if observed is not None:
                function_checks.columns(observed[0], value)
                value = function_checks.returned("observation", value, observed, "one element for each column of y")
                size = jax.eval_shape(model.observation_space.residual, value, value).shape[0]
                model.observation_noise.fits("observation_noise", size, "row of y")
            return jnp.asarray(value).astype(dtype)

        noises = self.process.at(k), self.observation.at(k)
        return Functions(folded(f), folded(h), *noises, model.state_space, model.observation_space)


def measured(y: Array, size: int) -> Bool[Array, " m"]:
    """Which elements of an innovation of that size were measured; on a manifold, all or none."""
    missing = jnp.isnan(y)
    return ~missing if y.shape[0] == size else jnp.broadcast_to(~missing.any(), (size,))


def initial(model: StateSpaceModel) -> Density:
    """The density of x[0], about its mean."""
    mean = model.initial.mean
    if model.initial.distribution is not None:
        return Given(model.initial.distribution, mean)
    cov = model.initial.cov.astype(mean.dtype)
    return Normal(jnp.zeros(cov.shape[0], mean.dtype), Spread.of(cov), whitening(cov))
