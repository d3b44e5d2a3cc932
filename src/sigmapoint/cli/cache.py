"""Compiled programs are kept between runs of the command line."""

import os

import jax
from platformdirs import user_cache_path

BYTES = 2**28
"""At most so many are kept, the ones used last."""


def kept_between_runs() -> None:
    """Let JAX keep what it compiles in the user's cache folder.

    A folder of the user's own (`JAX_COMPILATION_CACHE_DIR`) stays; `JAX_ENABLE_COMPILATION_CACHE=false` switches the
    cache off.
    """
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        jax.config.update("jax_compilation_cache_dir", str(user_cache_path("sigmapoint") / "compiled"))
        if "JAX_COMPILATION_CACHE_MAX_SIZE" not in os.environ:
            jax.config.update("jax_compilation_cache_max_size", BYTES)
        if "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS" not in os.environ:
            jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
