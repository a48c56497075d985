"""The levels of slip and twist, from rates of false reports."""

from itertools import pairwise

import pytest

from cnnum.errors import ProgramError
from cnnum.programs.library import get_program
from cnnum.templates.tactile.shared.false_reports import SLIP, TWIST, level_of


@pytest.mark.parametrize("levels", [SLIP, TWIST])
def test_fewer_false_reports_need_a_higher_level(levels):
    for rate, level in levels:
        assert level_of(rate, levels) == pytest.approx(level)
    for (few, high), (many, low) in pairwise(levels):
        assert level_of((few * many) ** 0.5, levels) == pytest.approx((high + low) / 2)
        assert high > low


def test_a_rate_that_was_not_measured_is_refused():
    with pytest.raises(ProgramError, match=r"'false_reports': expected 0\.5 to 11\.6, got 100"):
        level_of(100.0, SLIP)


def test_a_rate_may_have_a_unit():
    slip = get_program("slip")
    asked = dict(slip.bind(false_reports="6 /h").parameters)
    assert asked["false_reports"] == pytest.approx(1.0)
    assert dict(slip.bind(false_reports="2 /10min").parameters)["false_reports"] == 2.0
    with pytest.raises(ProgramError, match="false reports in ten minutes"):
        slip.bind(false_reports="2 /day")
