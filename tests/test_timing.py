"""How long calls take."""

import time

from sigmapoint.timing import clocked, in_turn


def test_calls_are_taken_in_turn_after_a_first_round():
    calls = []
    taken = in_turn({name: lambda name=name: calls.append(name) for name in "ab"}, 2)
    assert calls == ["a", "b"] * 3
    assert taken["a"].shape == taken["b"].shape == (2,)


def test_a_call_is_waited_for():
    result, seconds = clocked(lambda: time.sleep(0.05) or {"made": 1})
    assert result == {"made": 1}
    assert seconds >= 0.05
