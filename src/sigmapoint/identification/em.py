"""Expectation-maximisation: noises, the initial belief and parameters of a model from measurements alone.

Each step smooths with the model as it is (`expectation`), and takes the model under which what is then expected is the
most likely. For the covariances and the initial belief that is a mean of second moments; for parameters, a search by
gradient. For a linear model the likelihood of the measurements rises at every step (Dempster, Laird & Rubin 1977); for
another, as far as the method's Gaussians go.

Source: Shumway & Stoffer, "An approach to time series smoothing and forecasting using the EM algorithm" (1982).
"""

import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.belief import symmetric
from sigmapoint.blackbox import unwrapped
from sigmapoint.filtering import prepared
from sigmapoint.identification import expectation
from sigmapoint.identification.expectation import Moments, Smoothed
from sigmapoint.identification.joint import built
from sigmapoint.identification.unknowns import Unknowns
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel
from sigmapoint.noise import Additive, Gaussian
from sigmapoint.step import Filter

Structure = Callable[[Float[Array, "n n"]], Float[Array, "n n"]]
"""A covariance from the second moment found for it."""


def full(moment: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """A covariance without a structure, for `em`."""
    return moment


def diagonal(moment: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """A covariance without correlations, for `em`."""
    return jnp.diag(jnp.diagonal(moment))


def tied(moment: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """One variance for all elements, for `em`."""
    return jnp.mean(jnp.diagonal(moment)) * jnp.eye(moment.shape[0], dtype=moment.dtype)


class Found(NamedTuple):
    """All that is estimated; nothing in place of what is not."""

    z: Float[Array, " L"] | None
    process: Float[Array, "n n"] | None
    observation: Float[Array, "m m"] | None
    initial: Gaussian | None


class Problem(eqx.Module):
    """What is known, and how the rest is sought."""

    build: Callable[[Any], StateSpaceModel] = eqx.field(static=True)
    unknowns: Unknowns | None
    method: Method = eqx.field(static=True)
    process: Structure | None = eqx.field(static=True)
    observation: Structure | None = eqx.field(static=True)
    initial: Structure | None = eqx.field(static=True)

    def model(self, found: Found) -> StateSpaceModel:
        """The model as found so far."""
        theta = None if self.unknowns is None or found.z is None else self.unknowns.tree(found.z)
        model = built(self.build, theta)
        if found.process is not None:
            model = eqx.tree_at(lambda m: m.process_noise, model, _with(model.process_noise, found.process))
        if found.observation is not None:
            model = eqx.tree_at(lambda m: m.observation_noise, model, _with(model.observation_noise, found.observation))
        return model if found.initial is None else eqx.tree_at(lambda m: m.initial, model, found.initial)


class EM(NamedTuple):
    """What `em` found."""

    model: StateSpaceModel
    """with the parameters, noises and initial belief of the highest likelihood"""
    theta: Any
    """the parameters, a pytree as given; nothing where none were"""
    log_likelihood: Float[np.ndarray, " K"]
    """before the first step and after each; natural logarithms, by the filter"""
    converged: bool
    """whether the last step changed it by less than the tolerance"""
