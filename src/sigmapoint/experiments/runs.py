"""How many runs each method of an experiment gets: those that a claim compares get more."""

from collections.abc import Iterable
from typing import NamedTuple


class Runs(NamedTuple):
    """Numbers of runs. The fewer are the first of the more: from the same starts, on the same data."""

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
