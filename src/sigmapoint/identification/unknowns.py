"""All unknown parameters of a model: any pytree, seen by the estimators as a vector z with a Gaussian prior.

Elements of z have a prior of mean 0 and variance 1, in whatever units the parameters are (`unknown`): 1e-9 beside 1e6
is no matter. With `sp.Gaussian` in place of a pytree, z is the vector itself.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.checks.function_checks import note_keys
from sigmapoint.identification.unknown import Unknown, real
from sigmapoint.model import StateSpaceModel
from sigmapoint.noise import Gaussian


class Unknowns(eqx.Module):
    """All unknown parameters of a model, as one vector."""

    prior: Gaussian
    """of z"""
    tree: Any
    """the parameters at z"""
    names: tuple[str, ...] = eqx.field(static=True)
    """of the elements of z"""

    @classmethod
    def of(cls, theta: Any) -> "Unknowns":
        """From a `Gaussian` over a vector, or a pytree of unknowns; a number in it is one of its own size (0: of 1).

        Raises:
            ValueError: nothing that is unknown.
        """
        if isinstance(theta, Gaussian):
            L = theta.mean.shape[0]
            if theta.cov.shape != (L, L):
                raise ValueError(f"theta must have a covariance ({L}, {L}), got shape {theta.cov.shape}")
            return cls(theta, _Vector(), tuple(f"theta{i}" for i in range(L)))
        theta = jax.tree.map(_of_its_size, theta, is_leaf=_is_unknown)
        unknowns, rest = eqx.partition(theta, _is_unknown, is_leaf=_is_unknown)
        found = jax.tree_util.tree_leaves_with_path(unknowns, is_leaf=_is_unknown)
        if not sum(leaf.center.size for _, leaf in found):
            raise ValueError(
                "theta has no unknown parameters: it must be a sp.Gaussian, or a pytree with sp.real(), sp.positive(), "
                "sp.bounded() or numbers in it"
            )
        dtype = jnp.result_type(*(leaf.center.dtype for _, leaf in found))
        L = sum(leaf.center.size for _, leaf in found)
        names = tuple(name for path, leaf in found for name in _names(path, leaf.center.shape))
        return cls(Gaussian(jnp.zeros(L, dtype), jnp.eye(L, dtype=dtype)), _Tree(unknowns, rest), names)

    @property
    def size(self) -> int:
        """Number of elements of z."""
        return self.prior.mean.shape[0]

    def values(self, z: Float[Array, " L"]) -> Float[Array, " L"]:
        """The parameters at z in their own units, one after the other, as they are named."""
        return self.tree.values(z)

    @property
    def flat(self) -> "Unknowns":
        """The same with the vector of `values` as its pytree."""
        return Unknowns(self.prior, _Flat(self.tree), self.names)


class _Flat(eqx.Module):
    """z as the vector of the parameters of another pytree."""

    tree: Any

    def __call__(self, z: Float[Array, " L"]) -> Array:
        return self.tree.values(z)

    only = values = __call__

    def complete(self, unknowns: Array) -> Array:
        return unknowns


class _Vector(eqx.Module):
    """z is the parameters."""

    def __call__(self, z: Float[Array, " L"]) -> Array:
        return z

    def only(self, z: Float[Array, " L"]) -> Array:
        return z

    def complete(self, unknowns: Any) -> Any:
        return unknowns

    def values(self, z: Float[Array, " L"]) -> Float[Array, " L"]:
        return z


class _Tree(eqx.Module):
    """z as a pytree of parameters."""

    unknowns: Any
    rest: Any

    def __call__(self, z: Float[Array, " L"]) -> Any:
        return self.complete(self.only(z))

    def complete(self, unknowns: Any) -> Any:
        """With what is no parameter in its place."""
        return eqx.combine(unknowns, self.rest)

    def values(self, z: Float[Array, " L"]) -> Float[Array, " L"]:
        return jnp.concatenate([jnp.ravel(leaf).astype(z.dtype) for leaf in jax.tree.leaves(self.only(z))])

    def only(self, z: Float[Array, " L"]) -> Any:
        """The parameters, and nothing in place of what is none."""
        taken = 0

        def leaf(unknown: Unknown) -> Array:
            nonlocal taken
            part = z[taken : taken + unknown.center.size].reshape(unknown.center.shape)
            taken += unknown.center.size
            return unknown.range.value(unknown.center, unknown.std, part.astype(unknown.center.dtype))

        return jax.tree.map(leaf, self.unknowns, is_leaf=_is_unknown)


def built(build: Callable[[Any], StateSpaceModel], theta: Any) -> StateSpaceModel:
    """The model with these parameters.

    Raises:
        ValueError: `build` gives something else, or asks for a number where there is none yet.
    """
    try:
        model = build(theta)
    except (jax.errors.ConcretizationTypeError, jax.errors.TracerArrayConversionError) as error:
        raise ValueError(
            "build(theta) must be a function that JAX can trace: no float(), np.asarray() or `if` on parameters; use "
            "jax.numpy, and jnp.where for branches"
        ) from error
    except KeyError as error:
        note_keys(error, "build", "theta", theta)
        raise
    checks.instance("build(theta)", model, StateSpaceModel)
    return model


def names_of(theta: Any) -> tuple[str, ...]:
    """Of the parameters in a pytree of their values, element by element."""
    found = jax.tree_util.tree_leaves_with_path(eqx.filter(theta, eqx.is_inexact_array))
    return tuple(name for path, leaf in found for name in _names(path, leaf.shape))


def _is_unknown(a: Any) -> bool:
    return isinstance(a, Unknown)


def _of_its_size(a: Any) -> Any:
    number = isinstance(a, int | float) and not isinstance(a, bool)
    if not number and not eqx.is_inexact_array(a) and not (isinstance(a, np.ndarray) and a.dtype.kind == "f"):
        return a
    value = checks.array("theta", a)
    return real(value, jnp.where(value == 0, 1.0, jnp.abs(value)))


def _names(path: Any, shape: tuple[int, ...]) -> list[str]:
    name = jax.tree_util.keystr(path, simple=True, separator=".") or "theta"
    return [name] if not shape else [name + "".join(f"[{i}]" for i in at) for at in np.ndindex(*shape)]
