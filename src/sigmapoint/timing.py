"""How long calls take, their results waited for."""

import time
from collections.abc import Callable, Hashable, Mapping
from typing import Any, TypeVar

import jax
import numpy as np
from jaxtyping import Float

Name = TypeVar("Name", bound=Hashable)
Result = TypeVar("Result")


def clocked(call: Callable[[], Result]) -> tuple[Result, float]:
    """Its result, once that is there, and the seconds it took."""
    begin = time.perf_counter()
    result = jax.block_until_ready(call())
    return result, time.perf_counter() - begin


def in_turn(calls: Mapping[Name, Callable[[], Any]], repetitions: int) -> dict[Name, Float[np.ndarray, " N"]]:
    """Seconds of every call, all of them in turn, after a first round that compiles.

    What else the machine does meets all of them alike.
    """
    rounds = [[clocked(call)[1] for call in calls.values()] for _ in range(1 + repetitions)]
    return {name: np.array([one[i] for one in rounds[1:]]) for i, name in enumerate(calls)}
