"""Every test runs in float64 with strict promotion; shapes in annotations are checked as the library runs."""

import os
from pathlib import Path

# Most programs here run once: compile fast. The native forms of small arrays have tests of their own.
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false")
os.environ.setdefault("SIGMAPOINT_NATIVE", "0")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # threads of several workers wait for each other
os.environ["JAX_ENABLE_COMPILATION_CACHE"] = "false"  # the command line would use that of the user

import jax
import jax.numpy as jnp
import pytest
from jaxtyping import install_import_hook

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

with install_import_hook("sigmapoint", "beartype.beartype"):
    import sigmapoint

# A compiled program takes some hundred of the 65,530 memory maps a process may have; past them the compiler crashes.
MOST_MAPS = 25_000
MAPS = Path("/proc/self/maps")


@pytest.fixture(autouse=True)
def _not_too_many_programs():
    yield
    if MAPS.exists() and MAPS.read_bytes().count(b"\n") > MOST_MAPS:
        jax.clear_caches()


@pytest.fixture(scope="session")
def unit_vector():
    """A model that measures (cos θ, sin θ), two elements with one degree of freedom, and T measurements of it."""
    from turning import CIRCLE

    sp = sigmapoint
    model = sp.StateSpaceModel(
        lambda x, u: x + 0.1,
        lambda x, u: jnp.stack([jnp.cos(x[0]), jnp.sin(x[0])]),
        1e-4 * jnp.eye(1),
        1e-2 * jnp.eye(1),
        sp.Gaussian(jnp.zeros(1), 0.01 * jnp.eye(1)),
        state_space=sp.angles(0),
        observation_space=CIRCLE,
        state_names=("heading",),
        observation_names=("east", "north"),
        observation_units=("V", "V"),
    )
    return lambda T: (model, sp.simulate(model, T, key=jax.random.key(0))[1])
