"""What is said of a result, and how serious it is."""

from collections.abc import Iterable
from typing import Literal, NamedTuple

Severity = Literal["good", "warning", "bad"]


class Verdict(NamedTuple):
    """One sentence or two, and how serious it is."""

    severity: Severity
    text: str


RANK = {"bad": 0, "warning": 1, "good": 2}


def gravest_first(verdicts: Iterable[Verdict]) -> list[Verdict]:
    """In the order in which they should be read."""
    return sorted(verdicts, key=lambda verdict: RANK[verdict.severity])
