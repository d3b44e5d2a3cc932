"""What worker processes gain: the same work with one and with two, in turns, and beside it work that only counts.

On a machine that does other work, two processes may get no more of it than one. What two gain that need a processor and
nothing else says how much there was to gain.
"""

from collections.abc import Callable
from contextlib import closing
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import sigmapoint as sp
from sigmapoint.blackbox import Blackbox
from sigmapoint.experiments.f15.runs import Tracker
from sigmapoint.methods import Method
from sigmapoint.problems import f15
from sigmapoint.problems.f15_simulator import Input
from sigmapoint.timing import in_turn

COUNT = 2e6
"""for each of two processes: some tenths of a second, as the work beside it"""
PIECE = 5
"""steps of a filter"""


class Times(NamedTuple):
    """[s] of the same work, several times, with one worker process and with two."""

    one: Float[np.ndarray, " N"]
    two: Float[np.ndarray, " N"]
    """each right after its neighbour in `one`"""

    @property
    def ratio(self) -> Float[np.ndarray, " N"]:
        """How many times as fast two are."""
        return self.one / self.two

    @property
    def median(self) -> float:
        """Of pairs."""
        return float(np.median(self.ratio))

    @property
    def shortest(self) -> float:
        """The same by the shortest times: what else the machine does only adds to a time."""
        return float(self.one.min() / self.two.min())


def counted(number: Float[np.ndarray, " 1"]) -> Float[np.ndarray, " 1"]:
    """Count up to a number: work that needs a processor and nothing else."""
    total = 0.0
    while total < number[0]:
        total += 1.0
    return np.array([total])


def counting(box: Blackbox) -> Callable[[], Array]:
    """Two equal counts by a black box of `counted`."""
    count, numbers = jax.jit(jax.vmap(box)), jnp.full((2, 1), COUNT)
    return lambda: count(numbers).block_until_ready()


def times(
    tracker: Tracker, method: Method, noise: np.ndarray, y: np.ndarray, u: Input, repetitions: int
) -> dict[str, Times]:
    """Of a joint filter for these flights, and of counting; `tracker` is the filter with two workers."""
    piece = jax.tree.map(lambda a: a[:, :PIECE], (y, u))
    with (
        closing(f15.simulator(1)) as slow,
        closing(sp.blackbox(counted, workers=1)) as one,
        closing(sp.blackbox(counted, workers=2)) as two,
    ):
        alike = Tracker(f15.joint_model(slow, noise), method)
        works = {
            ("filter", 1): partial(alike, *piece),
            ("filter", 2): partial(tracker, *piece),
            ("counting", 1): counting(one),
            ("counting", 2): counting(two),
        }
        taken = in_turn(works, repetitions)
    return {name: Times(taken[name, 1], taken[name, 2]) for name in ("filter", "counting")}
