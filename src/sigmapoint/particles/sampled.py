"""What all filters that draw know at one instant: weights, where they are in their random numbers, and moments."""

import dataclasses
from abc import abstractmethod
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sigmapoint import checks
from sigmapoint.particles.weights import Cloud, effective
from sigmapoint.spaces import Space

RUN = 0x5A3D11
"""Sets the draws of a filter apart from those of `simulate` with the same key."""
Own = TypeVar("Own", bound="Sampled")


class Draws(NamedTuple):
    """Random numbers of a run: a key, and how many operations have drawn from it."""

    key: Array
    operations: Int[Array, ""]

    @classmethod
    def of(cls, key: Array | None) -> "Draws":
        """Of a run that begins; others that the same key is given to draw other numbers."""
        assert key is not None
        return cls(jax.random.fold_in(key, RUN), jnp.zeros((), int))

    def key_for(self, purpose: int) -> Array:
        """The key of this operation for one purpose."""
        return jax.random.fold_in(jax.random.fold_in(self.key, self.operations), purpose)

    def after(self) -> "Draws":
        """Of the next operation."""
        return self._replace(operations=self.operations + 1)


class Sampled(eqx.Module):
    """A belief made of weighted draws."""

    log_weights: Float[Array, " N"]
    draws: Draws
    space: Space = eqx.field(static=True)

    @property
    @abstractmethod
    def moments(self) -> Cloud:
        """Mean, covariance and standard deviations."""

    @property
    def mean(self) -> Float[Array, " d"]:
        """Mean of the state, in its units."""
        return self.moments.mean

    @property
    def cov(self) -> Float[Array, "n n"]:
        """Covariance of the state, in products of its units."""
        return self.moments.cov

    @property
    def std(self) -> Float[Array, " n"]:
        """Standard deviations of the state's elements, in their units."""
        return self.moments.std

    @property
    def ess(self) -> Float[Array, ""]:
        """Effective sample size, from 1 to the number of particles."""
        return effective(self.log_weights)

    def replace(self: Own, **fields: Any) -> Own:
        """With other values of some fields."""
        return dataclasses.replace(self, **fields)


def key_of_run(what: str, key: Any) -> Array:
    """The key of a run, without which a method that draws cannot be."""
    if key is None:
        raise ValueError(f"key is missing: {what} draws; pass key=jax.random.key(seed), or a seed")
    return checks.key("key", key)
