"""Checks of beliefs and noises: covariances that are none, means that do not fit them, spreads that points do not."""

import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from sigmapoint.checks import finite, known
from sigmapoint.spaces import Euclidean, folded

CANCELLED = 1e-3
"""Round-off of a mean, relative to the values that it is of, that is not passed over in silence."""


def covariance(name: str, value: Array, series: bool = False) -> None:
    """(n, n), or (T, n, n) where `series`; symmetric; positive semi-definite."""
    shapes = "(n, n) or (T, n, n)" if series else "(n, n)"
    if value.ndim not in ((2, 3) if series else (2,)) or value.shape[-1] != value.shape[-2] or value.shape[-1] == 0:
        hint = ""
        if value.ndim < 2:
            hint = "; for one variance an element write jnp.diag(jnp.array([...])), for a single one jnp.array([[0.1]])"
        raise ValueError(f"{name} must be a covariance of shape {shapes}, got shape {value.shape}{hint}")
    if not known(value):
        return
    finite(name, value)
    P = np.asarray(value, np.float64)
    tol = 100 * float(jnp.finfo(value.dtype).eps)
    scale = np.sqrt(np.abs(np.einsum("...ii->...i", P)))
    bound = scale[..., :, None] * scale[..., None, :]
    skew = np.abs(P - np.swapaxes(P, -1, -2))
    if (skew > tol * np.maximum(bound, np.abs(P).max() * 1e-3)).any():
        *_, i, j = np.unravel_index(np.argmax(skew), P.shape)
        raise ValueError(
            f"{name} must be symmetric; element [{i}, {j}] and its mirror differ by {skew.max():.3g}. "
            "If the difference is round-off, pass (P + P.T) / 2"
        )
    diagonal = np.einsum("...ii->...i", P)
    if (diagonal < 0).any():
        i = np.argwhere(diagonal < 0)[0][-1]
        raise ValueError(
            f"{name} has a negative variance, {diagonal.min():.6g}, at element [{i}, {i}]; it must be >= 0"
        )
    correlation = P / np.where(bound > 0, bound, 1.0)
    lowest = np.linalg.eigvalsh((correlation + np.swapaxes(correlation, -1, -2)) / 2).min()
    if lowest < -tol * P.shape[-1] or (np.abs(P)[bound == 0] > 0).any():
        raise ValueError(
            f"{name} must be positive semi-definite; as a correlation matrix its smallest eigenvalue is {lowest:.3g}"
        )


def singular(cov: Any) -> bool:
    """Whether any covariance of a series leaves a combination of elements without a variance of its own."""
    P = np.asarray(cov, np.float64)
    scale = np.sqrt(np.einsum("...ii->...i", P))
    bound = scale[..., :, None] * scale[..., None, :]
    if not (bound > 0).all():
        return True
    return bool(np.linalg.eigvalsh(P / bound).min() <= P.shape[-1] * float(jnp.finfo(cov.dtype).eps))


def gaussian(name: str, noise: Any) -> None:
    """A noise that has a covariance, as a Gaussian filter needs."""
    if noise.distribution is not None and known(noise.cov) and not np.isfinite(np.asarray(noise.cov)).all():
        kind = type(noise).__name__
        raise ValueError(
            f"{name}: this distribution has no finite variance, which a Gaussian filter needs: give it a covariance "
            f"beside the distribution, sp.{kind}(cov, distribution=...), or use a particle filter, sp.bootstrap(1000)"
        )


def initial(belief: Any, space: Any) -> None:
    """Mean, covariance and state space fit together."""
    mean, cov = belief.mean, belief.cov
    if mean.ndim != 1:
        raise ValueError(f"initial.mean must be (n,), got shape {mean.shape}")
    tangent = jax.eval_shape(space.residual, mean, mean).shape[0]
    if cov.shape != (tangent, tangent):
        raise ValueError(
            f"initial.cov must be ({tangent}, {tangent}) for a mean of shape {mean.shape}, got {cov.shape}"
        )


def digits(centre: float, dtype: Any) -> None:
    """A mean is values of the weights' size that cancel: digits are lost to a large weight of the centre."""
    lost = centre * float(jnp.finfo(dtype).eps)
    if lost > CANCELLED:
        warnings.warn(
            f"the sigma points of this method are so close together that means are good to about {lost:.1g} of a "
            f"value only in {dtype}: spread them (alpha=1), or compute in 64 bits: "
            'jax.config.update("jax_enable_x64", True)',
            stacklevel=5,
        )


def room(belief: Any, reach: float, space: Any, names: tuple[str, ...]) -> None:
    """Points `reach` standard deviations out stay where they are put; an angle past half a turn does not."""
    if isinstance(space, Euclidean) or not (known(belief.mean) and known(belief.cov)):
        return
    std = jnp.sqrt(jnp.diagonal(belief.cov)).astype(belief.mean.dtype)
    comes_back = folded(space, jnp.broadcast_to(belief.mean, (len(std), *belief.mean.shape)), std, reach)
    if comes_back.any():
        i = int(np.argmax(comes_back))
        name = names[i] if len(names) == len(std) else f"element {i}"
        raise ValueError(
            f"initial: the standard deviation of {name}, {float(std[i]):.3g}, is too wide for its space: a sigma point "
            f"{reach:.3g} of them away comes back elsewhere, as an angle does past half a turn. Use a smaller one, or "
            "sp.ekf(), or hold the angle as its cosine and sine"
        )
