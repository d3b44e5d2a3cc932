"""Draw a series from a model."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from sigmapoint import checks
from sigmapoint.blackbox import unwrapped
from sigmapoint.checks import data_checks
from sigmapoint.model import StateSpaceModel
from sigmapoint.system import System, initial


def simulate(
    model: StateSpaceModel, T: int, *, key: Array | int, u: Any = None
) -> tuple[Float[Array, "T d"], Float[Array, "T m"]]:
    """Draw states and measurements from a model.

    Args:
        model: the model; its noises are drawn as the Gaussians or distributions that they are.
        T: number of samples.
        key: `jax.random.key(seed)`, or the seed.
        u: inputs with leading axis T, or nothing.

    Returns:
        States `x` (T, n) with x[0] from the initial belief, and measurements `y` (T, m).

    Raises:
        ValueError: T below 1, inputs that do not fit, a key that is none.

    Examples:
        >>> import jax, jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, jnp.eye(1), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(1), jnp.eye(1)))
        >>> x, y = sp.simulate(model, 100, key=jax.random.key(0))
        >>> x.shape, y.shape
        ((100, 1), (100, 1))
    """
    checks.instance("model", model, StateSpaceModel)
    T = checks.whole("T", T, 1)
    u = data_checks.inputs(u, T, model.initial.mean.dtype)
    data_checks.long_enough(T, process_noise=model.process_noise, observation_noise=model.observation_noise)
    return unwrapped(_simulate, model, T, checks.key("key", key), u)


@eqx.filter_jit
def _simulate(model: StateSpaceModel, T: int, key: Array, u: Any) -> tuple[Array, Array]:
    system, mean = System.of(model), model.initial.mean
    start, walk = jax.random.split(key)
    x0 = model.state_space.retract(mean, initial(model).draws(start, 1)[0])

    def step(x: Array, row: tuple[Array, Array, Any]) -> tuple[Array, tuple[Array, Array]]:
        k, noise, u_k = row
        fs = system.functions(k)
        for_w, for_v = jax.random.split(noise)
        w, v = (source.density(k).draws(key, 1)[0] for source, key in zip(system[1:], (for_w, for_v)))
        y, _ = fs.observation.drawn(fs.h, fs.observation_space)(x, u_k, v)
        return fs.process.drawn(fs.f, fs.state_space)(x, u_k, w)[0], (x, y)

    _, series = jax.lax.scan(step, x0, (jnp.arange(T), jax.random.split(walk, T), u))
    return series
