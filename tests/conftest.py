"""Every test runs in float64 with strict promotion; shapes in annotations are checked as the library runs."""

import os

os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")  # most programs here run once: compile fast

import jax
import pytest
from jaxtyping import install_import_hook

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

with install_import_hook("sigmapoint", "beartype.beartype"):
    import sigmapoint  # noqa: F401

# Every compiled program takes some ninety of the 65,530 memory maps a process may have; past them the compiler crashes.
MOST_PROGRAMS = 300
programs = 0


def _count(event: str, _seconds: float, **_) -> None:
    global programs
    programs += "backend_compile" in event


jax.monitoring.register_event_duration_secs_listener(_count)


@pytest.fixture(autouse=True)
def _not_too_many_programs():
    global programs
    yield
    if programs > MOST_PROGRAMS:
        jax.clear_caches()
        programs = 0
