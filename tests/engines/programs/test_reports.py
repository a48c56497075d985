"""Levels from rates of false reports, and the flags that they set."""

from itertools import pairwise

import numpy as np
import pytest

from cnnum.errors import ProgramError
from cnnum.programs import program
from cnnum.programs.library import get_program
from cnnum.programs.reports import level_of, report
from cnnum.templates.tactile.slip import LEVELS as SLIP
from cnnum.templates.tactile.slip import SHEAR_LEVELS as SHEAR
from cnnum.templates.tactile.twist import LEVELS as TWIST


@pytest.mark.parametrize("levels", [SLIP, TWIST])
def test_fewer_false_reports_need_a_higher_level(levels):
    for rate, level in levels:
        assert level_of(rate, levels) == pytest.approx(level)
    for (few, high), (many, low) in pairwise(levels):
        assert level_of((few * many) ** 0.5, levels) == pytest.approx((high + low) / 2)
        assert high > low


@pytest.mark.parametrize("levels", [SLIP, TWIST, SHEAR])
def test_any_rate_has_a_level(levels):
    """Beyond the measured rates levels go on: lower for more, and never down to 0."""
    rates = [1e-3, 0.01, 0.1, *(rate for rate, _ in levels), 100.0, 1e4]
    found = [level_of(rate, levels) for rate in sorted(rates)]
    assert all(few >= many > 0.0 for few, many in pairwise(found))
    assert found[0] > levels[0][1]
    with pytest.raises(ProgramError, match="'false_reports'"):
        level_of(0.0, levels)


def test_a_level_can_be_set_and_read(fast):
    for name, table in (("slip", SLIP), ("twist", TWIST)):
        at_rate = level_of(0.5, table)
        for whole, parameters, expected in (
            (name, {"level": 0.3}, 0.3),
            (name, {"false_reports": 0.5}, at_rate),
            ("tactile", {f"{name}_level": 0.3, f"{name}_false_reports": 0.5}, 0.3),
        ):
            bound, level = get_program(whole).bind(rate=100.0, **parameters), f"{name}_level"
            plan = fast.compile(bound, (4, 4), [level])
            read = float(plan.stream().push(np.zeros((4, 4, len(plan.schedule.channels))))[level])
            assert read == pytest.approx(expected, rel=1e-6)
    with pytest.raises(ProgramError, match="'level'"):
        get_program("slip").bind(level=-1.0, rate=100.0).trace((4, 4))


def test_a_rate_may_have_a_unit():
    slip = get_program("slip")
    asked = dict(slip.bind(false_reports="6 /h").parameters)
    assert asked["false_reports"] == pytest.approx(1.0)
    assert dict(slip.bind(false_reports="2 /10min").parameters)["false_reports"] == 2.0
    with pytest.raises(ProgramError, match="false reports in ten minutes"):
        slip.bind(false_reports="2 /day")


def test_a_report_ends_once_its_strength_was_low_for_a_time(fast):
    """Swings of a strength are one report where they come sooner than the time to hold."""

    @program
    def reported(frame):
        return {"on": report(frame, frame.normal.max(), 1.0, 5.0)}

    high, middle, low = 1.2, 0.7, 0.2
    strengths = [0, 0, 0, 0, middle, high, *5 * [low], middle, *5 * [low], low, high, *6 * [low]]
    stream = fast.compile(reported, (2, 2), channels=("normal",)).stream()
    on = [float(stream.push(np.full((2, 2), float(strength)))["on"]) for strength in strengths]
    # on at the level only, kept for five low frames and by half the level, off at the sixth
    expected = [0, 0, 0, 0, 0, 1, *5 * [1], 1, *5 * [1], 0, 1, *5 * [1], 0]
    assert on == expected
