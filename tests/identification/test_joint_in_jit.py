"""Joint models made while JAX traces: what parameters were thought to be may differ from series to series."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sigmapoint as sp

Y = 0.9 ** jnp.arange(30.0)[:, None]


def known_noise(theta):
    return sp.StateSpaceModel(
        lambda x, u: theta * x,
        lambda x, u: x,
        0.01 * jnp.eye(1),
        0.01 * jnp.eye(1),
        sp.Gaussian(jnp.ones(1), jnp.eye(1)),
    )


def noise_that_depends(theta):
    return sp.StateSpaceModel(
        lambda x, u: theta * x,
        lambda x, u: x,
        0.01 * theta**2 * jnp.eye(1),
        0.01 * jnp.eye(1),
        sp.Gaussian(theta[None], jnp.eye(1)),
    )


@pytest.mark.parametrize("build", [known_noise, noise_that_depends])
def test_starts_by_vmap_in_jit_are_those_one_by_one(build):
    def last(start):
        theta = sp.positive(start, 0.3)
        return sp.estimates(theta, sp.filter(sp.joint(build, theta), Y)).value[-1]

    starts = jnp.array([0.5, 0.7])
    np.testing.assert_allclose(jax.jit(jax.vmap(last))(starts), [last(start) for start in starts], rtol=1e-12)


def test_only_a_noise_that_depends_on_parameters_becomes_a_part_of_the_points():
    theta = sp.positive(0.5, 0.3)
    assert isinstance(sp.joint(known_noise, theta).process_noise, sp.Additive)
    assert isinstance(sp.joint(noise_that_depends, theta).process_noise, sp.NonAdditive)
