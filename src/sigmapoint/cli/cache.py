"""Compiled programs are kept between runs of the command line."""

import os

import jax
from platformdirs import user_cache_path

BYTES = 2**28
"""At most so many are kept, the ones used last."""
SHORTEST = 0.1
"""Seconds of compilation from which on a program is kept."""


def kept_between_runs() -> None:
    """Let JAX keep what it compiles in the user's cache folder, if there can be one.

    A folder of the user's own (`JAX_COMPILATION_CACHE_DIR`) and its settings stay; `JAX_ENABLE_COMPILATION_CACHE=false`
    switches the cache off.
    """
    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    folder = user_cache_path("sigmapoint") / "compiled"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return
    if os.access(folder, os.W_OK):
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_compilation_cache_max_size", BYTES)
        jax.config.update("jax_persistent_cache_min_compile_time_secs", SHORTEST)
