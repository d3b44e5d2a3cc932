"""Every test runs in float64 with strict promotion; shapes in annotations are checked as the library runs."""

import jax
from jaxtyping import install_import_hook

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

with install_import_hook("sigmapoint", "beartype.beartype"):
    import sigmapoint  # noqa: F401
