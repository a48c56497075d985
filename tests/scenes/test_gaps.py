"""Gaps are said as they are met: each long one, and short ones together."""

import numpy as np

from cnnum.frame import FORCE_AXES, Frame, Quality
from cnnum.scenes.bad_taxels import Gap, GapWatch

RATE = 100.0


def said(numbers: list[int]) -> list[Gap]:
    """Return the gaps that are said of a stream of these scans."""
    watch, found = GapWatch(), list[Gap]()
    for place, number in enumerate(numbers):
        missed = place > 0 and number != numbers[place - 1] + 1
        quality = Quality.DROPPED_BEFORE if missed else Quality.GOOD
        frame = Frame(np.zeros((1, 1, 3)), FORCE_AXES, "N", number, number / RATE, quality)
        gap = watch.seen(place, frame)
        if gap is not None:
            found.append(gap)
    return found


def test_a_long_gap_has_a_record_of_its_own() -> None:
    first, second = said([0, 1, 52, 53, 73])
    assert first.record() == {
        "kind": "gap", "t": 0.52, "frame": 2, "seconds": 0.51, "missing": 50, "gaps": 1,
    }  # fmt: skip
    assert (second.frame, second.missing) == (4, 19)
    assert str(first) == "    0.520 s  gap 0.510 s, 50 scans missing"


def test_short_gaps_are_counted_together_and_none_is_left_out() -> None:
    numbers = [n for n in range(1000) if n % 10 != 5]
    found = said(numbers)
    assert len(found) == 10  # one a second
    missing = sum(gap.missing for gap in found)
    assert missing == sum(gap.gaps for gap in found)
    assert 90 <= missing <= 100  # those of the last second are not said yet
    assert max(gap.seconds for gap in found) < 0.021
    assert "gaps, the longest 0.020 s" in str(found[1])


def test_a_whole_stream_has_none() -> None:
    assert said(list(range(50))) == []
