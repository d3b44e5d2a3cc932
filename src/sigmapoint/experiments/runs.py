"""How many runs each method of an experiment gets: those that a claim compares get more."""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple, TypeVar

import jax

Name = TypeVar("Name")
Found = TypeVar("Found")


class Runs(NamedTuple):
    """Numbers of runs. The fewer are the first of the more, with the same starts and data run by run."""

    each: int
    compared: int
    """of a method that the claim compares with another"""
    quick: int

    def of(self, names: Iterable[str], compared: Iterable[str], given: int | None, quick: bool) -> dict[str, int]:
        """Runs by method; `given` by the user, or these.

        Examples:
            >>> Runs(10, 40, 2).of(("EKF", "UKF", "CDKF"), ("EKF", "UKF"), None, False)
            {'EKF': 40, 'UKF': 40, 'CDKF': 10}
        """
        own = dict.fromkeys(compared, self.compared)
        return {name: given or (self.quick if quick else own.get(name, self.each)) for name in names}


def alike(found: Mapping[Name, Found]) -> dict[Name, Found]:
    """What was found by each method, arrays (runs, …), in the runs that all of them have."""
    fewest = min(len(a) for one in found.values() for a in jax.tree.leaves(one))
    return {name: first(one, fewest) for name, one in found.items()}


def first(arrays: Any, runs: int) -> Any:
    """The first so many runs."""
    return jax.tree.map(lambda a: a[:runs], arrays)
