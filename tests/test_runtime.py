"""The setting of XLA is added where it can be, and nowhere else."""

import os
import subprocess
import sys

import pytest

SHOW = "from sigmapoint import runtime; import os; print(runtime.NATIVE, os.environ.get('XLA_FLAGS', ''))"
OWN = "--xla_backend_extra_options=xla_cpu_some_other_option=1"
STARTED = "import jax; jax.devices();"


def _shown(code, **environment):
    kept = {k: v for k, v in os.environ.items() if k not in ("XLA_FLAGS", "SIGMAPOINT_NATIVE")}
    ran = subprocess.run(
        [sys.executable, "-c", code], env=kept | environment, capture_output=True, text=True, check=True
    )
    native, _, flags = ran.stdout.strip().partition(" ")
    return native == "True", flags


@pytest.mark.parametrize(
    ("code", "environment", "native", "kept"),
    [
        (SHOW, {}, True, ""),
        (SHOW, {"XLA_FLAGS": "--xla_cpu_enable_fast_math=false"}, True, "--xla_cpu_enable_fast_math=false"),
        (SHOW, {"XLA_FLAGS": OWN}, False, OWN),
        (SHOW, {"SIGMAPOINT_NATIVE": "0"}, False, ""),
        (STARTED + SHOW, {}, False, ""),
    ],
    ids=["new process", "other flags of the user", "the same flag of the user", "switched off", "JAX has started"],
)
def test_when_the_setting_is_added(code, environment, native, kept):
    found, flags = _shown(code, **environment)
    assert found == native
    added = " --xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=524288" if native else ""
    assert flags == (kept + added).strip()
