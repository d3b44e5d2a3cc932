"""Every test runs in float64 with strict promotion; shapes in annotations are checked as the library runs."""

import os
from pathlib import Path

os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")  # most programs here run once: compile fast

import jax
import pytest
from jaxtyping import install_import_hook

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

with install_import_hook("sigmapoint", "beartype.beartype"):
    import sigmapoint  # noqa: F401

# A compiled program takes a hundred or more of the 65,530 memory maps a process may have; past them the compiler crashes.
MOST_MAPS = 25_000
MAPS = Path("/proc/self/maps")


@pytest.fixture(autouse=True)
def _not_too_many_programs():
    yield
    if MAPS.exists() and MAPS.read_bytes().count(b"\n") > MOST_MAPS:
        jax.clear_caches()
