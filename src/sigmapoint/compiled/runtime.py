"""The one setting of XLA that makes long series fast on a CPU, and whether it is on.

XLA can compile a loop whose buffers are small into one native function, in place of a list of kernels that are
dispatched one by one: a step of a filter with a few states then takes about a microsecond in place of ten. The option
is read once, from the environment variable `XLA_FLAGS`, when JAX starts its CPU client; importing sigmapoint before
that adds it. It is left alone where

* `SIGMAPOINT_NATIVE=0` is set,
* `XLA_FLAGS` has `--xla_backend_extra_options` already (the user's own wins), or
* JAX has started: what is compiled then runs as without it, correct and slower.

`sigmapoint doctor` prints what holds.
"""

import os
from typing import Any

import jax

VARIABLE = "SIGMAPOINT_NATIVE"
OPTION = "xla_cpu_small_while_loop_byte_threshold"
SMALL = 2**19
"""Bytes in all buffers of a loop, up to which it is compiled into one function.

With twice as much, other programs suffer: loops over large arrays, which XLA spreads over the cores otherwise, took
nearly twice as long (`benchmarks/neighbours.py`).
"""


def prepare() -> tuple[bool, str]:
    """Add the option where that is possible; whether loops are native, and why."""
    flags = os.environ.get("XLA_FLAGS", "")
    if os.environ.get(VARIABLE) == "0":
        return False, f"switched off by {VARIABLE}=0"
    if "xla_backend_extra_options" in flags:
        return OPTION in flags, "XLA_FLAGS has xla_backend_extra_options of its own"
    if _started():
        return False, "JAX had started before sigmapoint was imported; import sigmapoint first"
    os.environ["XLA_FLAGS"] = f"{flags} --xla_backend_extra_options={OPTION}={SMALL}".strip()
    return True, f"{OPTION}={SMALL} in XLA_FLAGS"


def _started() -> bool:
    # JAX has no public way to ask without starting.
    bridge: Any = getattr(getattr(jax, "_src", None), "xla_bridge", None)
    known = getattr(bridge, "backends_are_initialized", None)
    return bool(known()) if known else False


NATIVE, REASON = prepare()
