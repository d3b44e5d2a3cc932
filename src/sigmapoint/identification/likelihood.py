"""The log-likelihood of measurements as a function of parameters, and with a prior the log-density after them.

    log p(z | y) = log p(y | θ(z)) + log N(z; m, P) + const,        log p(y | θ) = Σ log p(y[k] | y[0], …, y[k-1], θ),

each term of the sum what a filter predicts of the next measurement (the prediction error decomposition). The prior is
one of z itself, so no Jacobian of θ(z) enters.

Source: Schweppe, IEEE Trans. Inf. Theory 11 (1965) 61; Särkkä, "Bayesian Filtering and Smoothing" (2013), eq 12.5.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sigmapoint import checks
from sigmapoint.compiled.series import of_each
from sigmapoint.densities import LOG_2PI
from sigmapoint.filtering import gaussian, scan
from sigmapoint.identification.unknowns import Unknowns, built
from sigmapoint.methods import Method
from sigmapoint.model import StateSpaceModel
from sigmapoint.ragged import stacked
from sigmapoint.recipe import Recipe

ROUND_OFF = 1e-6
"""Negative variance that a matrix of correlations may have."""


class LogPosterior(eqx.Module):
    """The logarithm of the density of z, up to a constant; made by `log_posterior`.

    Under `jax.jit`, `jax.grad`, `jax.hessian` and `jax.vmap` it is one program, compiled once for each `build` (and
    without them, too). Where the value or a derivative is not finite, or a covariance of the model is none, it is -inf
    with a gradient of zero: a sampler rejects that, and a line search steps back. Derivatives go backward first: for
    `jax.jvp`, take `log_likelihood`.
    """

    build: Callable[[Any], StateSpaceModel]
    unknowns: Unknowns
    y: Float[Array, "S T m"]
    """of every series, NaN past its end"""
    u: Any
    lengths: Int[Array, " S"] | None
    """of the series, where they differ"""
    method: Recipe
    weight: Float[Array, ""]
    """of the prior"""

    # Compiled also where nobody asks for it: a model made of known numbers would refuse those that are no use.
    @eqx.filter_jit
    def __call__(self, z: Float[Array, " L"]) -> Float[Array, ""]:
        return _finite(z, self)

    @eqx.filter_jit
    def log_likelihood(self, z: Float[Array, " L"], key: Array | None = None) -> Float[Array, ""]:
        """Natural logarithm of the density of all measurements, as the filter has it; series are independent."""
        return self.filtered(z, key)[0]

    def filtered(
        self, z: Float[Array, " L"], key: Array | None = None, until: Int[Array, ""] | None = None
    ) -> tuple[Float[Array, ""], Any]:
        """The log-likelihood of the rows before `until` (of all), and what the filter of every series then knows."""
        model = built(self.build, self.theta(z))
        S, T = self.y.shape[:2]
        key = self.method.random(key)
        keys = None if key is None else jax.random.split(key, S)

        def one(y: Array, u: Any, end: Array | None, key: Array | None) -> tuple[Array, Any]:
            real = None if end is None else jnp.arange(T) < end
            return scan(self.method.ready(model, key), y, u, lambda state, info: None, real)[1:]

        ends = self.lengths if until is None else self.ends(until)
        each, ahead = of_each(one, self.y, self.u, ends, keys)
        return jnp.where(_is_model(model), each.sum(), -jnp.inf).astype(z.dtype), ahead

    def ends(self, until: Int[Array, ""]) -> Int[Array, " S"]:
        """Where the series end, or `until` where that is earlier."""
        S, T = self.y.shape[:2]
        return jnp.minimum(jnp.full(S, T) if self.lengths is None else self.lengths, until)

    def log_prior(self, z: Float[Array, " L"]) -> Float[Array, ""]:
        """Natural logarithm of the density of z before any measurement."""
        root = jnp.linalg.cholesky(self.unknowns.prior.cov)
        white = jax.scipy.linalg.solve_triangular(root, z - self.start, lower=True)
        return -0.5 * jnp.sum(white**2 + LOG_2PI) - jnp.sum(jnp.log(jnp.diagonal(root)))

    def prior_draws(self, key: Array, count: int) -> Float[Array, "count L"]:
        """Draws of z before any measurement."""
        white = jax.random.normal(key, (count, self.unknowns.size), self.start.dtype)
        return self.start[None] + white @ jnp.linalg.cholesky(self.unknowns.prior.cov).T

    def theta(self, z: Float[Array, " L"]) -> Any:
        """The parameters at z, in their own units."""
        return self.unknowns.tree(z)

    @property
    def start(self) -> Float[Array, " L"]:
        """The prior mean of z."""
        return self.unknowns.prior.mean

    @property
    def measured(self) -> int:
        """How many numbers were measured."""
        return int(np.sum(~np.isnan(self.y)))

    # Arrays have no hash, and `jax.jit` asks its function for one.
    def __hash__(self) -> int:
        return id(self)

    def __eq__(self, other: object) -> Any:
        return self is other


def _is_model(model: StateSpaceModel) -> Array:
    """Whether its covariances are: no filter has to notice a negative one. (A distribution's may be infinite.)"""
    beliefs = (model.process_noise, model.observation_noise, model.initial)
    covs = [belief.cov for belief in beliefs if belief.distribution is None]
    return jnp.stack([_is_covariance(jax.lax.stop_gradient(cov)) for cov in covs] or [jnp.ones((), bool)]).all()


def _is_covariance(cov: Float[Array, "*T n n"]) -> Array:
    variance = jnp.diagonal(cov, axis1=-2, axis2=-1)
    scale = jnp.sqrt(jnp.where(variance > 0, variance, 1.0))
    correlations = cov / (scale[..., :, None] * scale[..., None, :])
    return (variance >= 0).all() & (jnp.linalg.eigvalsh(correlations) >= -ROUND_OFF).all()


@eqx.filter_custom_vjp
def _finite(z: Float[Array, " L"], density: LogPosterior) -> Array:
    value = _density(z, density)
    return jnp.where(jnp.isfinite(value), value, -jnp.inf)


# The slope is found along with the value, so that one that is not finite can still say that the value is of no use.
@_finite.def_fwd
def _finite_and_slope(perturbed: Any, z: Array, density: LogPosterior) -> tuple[Array, Array]:
    value, slope = jax.value_and_grad(_density)(z, density)
    good = jnp.isfinite(value) & jnp.isfinite(slope).all()
    return jnp.where(good, value, -jnp.inf), jnp.where(good, slope, 0)


@_finite.def_bwd
def _along_slope(slope: Array, cotangent: Array, perturbed: Any, z: Array, density: LogPosterior) -> Array:
    return cotangent * slope


def _density(z: Array, density: LogPosterior) -> Array:
    return density.log_likelihood(z) + density.weight * density.log_prior(z)


def log_posterior(
    build: Callable[[Any], StateSpaceModel], theta: Any, y: Any, u: Any = None, method: Method | None = None
) -> LogPosterior:
    """The logarithm of the density of unknown parameters after measurements, for optimisers and samplers.

    It is a function of the vector z of all unknown parameters, which has no bounds and a Gaussian prior of mean 0 and
    deviation 1 for each element: what samplers like. `blackjax.nuts(density, ...)` takes it as it is; in numpyro write
    `numpyro.factor("y", density.log_likelihood(z))` beneath `z ~ Normal(0, 1)`.

    Args:
        build: `build(theta) -> StateSpaceModel`, a function that JAX can trace and differentiate. Noises and the
            initial belief may depend on the parameters.
        theta: the parameters and what is known of them, as for `joint`: a pytree of `sp.real`, `sp.positive`,
            `sp.bounded` and numbers, or `sp.Gaussian` over a vector.
        y: measurements (T, m), NaN where an element was not measured; or a list of independent series (Tᵢ, m).
        u: inputs, as for `filter`; for a list, a list of them.
        method: as for `filter`.

    Returns:
        A callable `LogPosterior`, `z (L,) -> ()`, with `log_likelihood(z)`, `log_prior(z)`, `theta(z)` and `start`.

    Raises:
        ValueError: no unknown parameters, a `build` that gives no model, shapes that do not fit, infinite measurements,
            NaN in `u`, a singular prior.

    Source: Särkkä (2013), eq 12.5.

    Examples:
        >>> import jax, jax.numpy as jnp, sigmapoint as sp
        >>> def build(theta):
        ...     return sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, theta["q"] * jnp.eye(1),
        ...                               0.1 * jnp.eye(1), sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> density = sp.log_posterior(build, {"q": sp.positive(0.1, 0.1)}, jnp.sin(jnp.arange(30.0))[:, None])
        >>> density(density.start).shape, jax.grad(density)(density.start).shape
        ((), (1,))
    """
    return posterior_of(build, theta, y, u, method, gaussian)


def posterior_of(
    build: Callable[[Any], StateSpaceModel],
    theta: Any,
    y: Any,
    u: Any,
    method: Recipe | None,
    checked: Callable[[StateSpaceModel, Recipe | None], Recipe],
) -> LogPosterior:
    """The same, of a method that is `checked` together with the model."""
    checks.function("build", build, "theta")
    unknowns = Unknowns.of(theta)
    _regular(unknowns)
    model = built(build, unknowns.tree(unknowns.prior.mean))
    method = checked(model, method)
    y, u, lengths = stacked(model, y, u)
    differ = lengths.min() < lengths.max()
    one = jnp.ones((), unknowns.prior.mean.dtype)
    return LogPosterior(build, unknowns, y, u, jnp.asarray(lengths) if differ else None, method, one)


def _regular(unknowns: Unknowns) -> None:
    if checks.known(unknowns.prior.cov):
        std = np.sqrt(np.diagonal(unknowns.prior.cov))
        if not (std > 0).all() or not np.isfinite(np.asarray(jnp.linalg.cholesky(unknowns.prior.cov))).all():
            raise ValueError("theta has a singular covariance: a prior density needs one that is positive definite")
