"""The setting of XLA is added where it can be, and nowhere else."""

import json
import os
import subprocess
import sys

OWN = "--xla_backend_extra_options=xla_cpu_some_other_option=1"
ADDED = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=524288"
# One process for all: the module is run again in each environment, before JAX starts and then after.
SHOW = """
import importlib, json, os, sys
from sigmapoint.compiled import runtime
import jax

def shown(**environment):
    for name in ("XLA_FLAGS", "SIGMAPOINT_NATIVE"):
        os.environ.pop(name, None)
    os.environ.update(environment)
    importlib.reload(runtime)
    return runtime.NATIVE, os.environ.get("XLA_FLAGS", "")

found = {"new process": (runtime.NATIVE, os.environ.get("XLA_FLAGS", ""))}
found["other flags of the user"] = shown(XLA_FLAGS="--xla_cpu_enable_fast_math=false")
found["the same flag of the user"] = shown(XLA_FLAGS=sys.argv[1])
found["switched off"] = shown(SIGMAPOINT_NATIVE="0")
jax.devices()
found["JAX has started"] = shown()
print(json.dumps(found))
"""


def test_when_the_setting_is_added():
    kept = {k: v for k, v in os.environ.items() if k not in ("XLA_FLAGS", "SIGMAPOINT_NATIVE")}
    ran = subprocess.run([sys.executable, "-c", SHOW, OWN], env=kept, capture_output=True, text=True, check=True)
    assert json.loads(ran.stdout) == {
        "new process": [True, ADDED],
        "other flags of the user": [True, f"--xla_cpu_enable_fast_math=false {ADDED}"],
        "the same flag of the user": [False, OWN],
        "switched off": [False, ""],
        "JAX has started": [False, ""],
    }
