"""Times in turns: a difference of two calls, and its share of a rate in the same turn."""

import math

import pytest

from cnnum.lab.bench import timing


@pytest.fixture
def clock(monkeypatch):
    """A clock that calls put forward; no time passes otherwise."""

    class Clock:
        now, slower = 0.0, 1.0

        def call(self, seconds):
            def run():
                self.now += seconds * self.slower

            return run

    clock = Clock()
    monkeypatch.setattr(timing.time, "perf_counter", lambda: clock.now)
    return clock


def test_a_share_in_turns_is_not_moved_by_what_slows_a_turn(clock):
    """In every other turn the machine takes three times as long, and its peak is a third."""
    asked = 0

    def peak():
        nonlocal asked
        clock.slower = 3.0 if asked // 3 % 2 else 1.0
        asked += 1
        return 100.0 / clock.slower

    found = timing.difference(
        clock.call(1.0), clock.call(3.0), work=120.0, against=peak, budget=100.0, runs=4
    )
    assert asked == 12
    assert found.share == pytest.approx(0.6)
    assert found.long.least == pytest.approx(3.0)
    assert found.more == pytest.approx(4.0)


def test_without_a_rate_beside_there_is_no_share(clock):
    found = timing.difference(clock.call(1.0), clock.call(3.0), budget=100.0)
    assert found.more == pytest.approx(2.0)
    assert math.isnan(found.share)
