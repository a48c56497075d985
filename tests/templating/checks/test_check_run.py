"""run_check: its figures, and the answers it refuses."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import pytest

from cnnum.errors import TemplateError, UnknownNameError
from cnnum.templating.checks import CheckResult, closed_form, form_of, run_check, running
from cnnum.templating.checks.digital.neighbourhood import pattern
from cnnum.templating.template import Check, Template

COPY = Template(
    "copy",
    A=[[0.0]],
    B=[[1.0]],
    duration=0.0,
    initial="input",
    check=Check("shift", (("direction", "east"),)),
    boundary=-1.0,
)


@dataclass
class Answer:
    output: Any
    state: Any = None
    method: str = "by hand"
    reason: str = "nothing else is at hand"


class Shifter:
    """Answers a shift to the east exactly, then spoils the answer as asked."""

    name = "shifter"
    precision = "float64"

    def __init__(self, spoil: Any = lambda answer: answer) -> None:
        self.spoil = spoil
        self.runs = 0

    def run(self, template: Template, *, input: Any, **others: Any) -> Answer:
        self.runs += 1
        answer = np.full_like(input, -1.0)
        answer[..., 1:] = input[..., :-1]
        return Answer(self.spoil(answer))


def test_result_has_the_fields_that_users_read() -> None:
    assert [field.name for field in fields(CheckResult)] == [
        "template",
        "engine",
        "precision",
        "method",
        "check",
        "error",
        "tolerance",
        "seconds",
        "passed",
        "reason",
        "margin",
        "settle",
        "note",
    ]


def test_exact_answer_passes_and_is_timed_after_a_first_run() -> None:
    engine = Shifter()
    result = run_check(COPY, engine, shape=(4, 6), repeats=3)
    assert (result.template, result.engine, result.precision) == ("copy", "shifter", "float64")
    assert (result.method, result.check, result.error) == ("by hand", "shift", 0.0)
    assert result.passed
    assert result.reason == "nothing else is at hand"
    assert result.seconds > 0.0
    assert engine.runs == 4


@pytest.mark.parametrize(
    ("first", "second", "expected"), [(1.0, 0.002, 0.002), (1.0, 0.6, 0.6), (9.0, 0.002, 9.0)]
)
def test_a_first_run_that_compiled_is_not_the_time(
    first: float, second: float, expected: float
) -> None:
    times = iter([second] * 3)
    assert running._time_of(first, 3, lambda: next(times)) == expected
    assert len(list(times)) == {0.002: 0, 0.6: 2, 9.0: 3}[expected]


def test_without_repeats_the_first_run_is_the_time() -> None:
    engine = Shifter()
    result = run_check(COPY, engine, repeats=0)
    assert engine.runs == 1
    assert result.passed
    assert result.seconds > 0.0


@pytest.mark.parametrize(
    ("spoil", "error"),
    [
        (lambda answer: answer + 0.5, 0.5),
        (lambda answer: answer * np.nan, np.inf),
        (lambda answer: answer[:, np.newaxis], np.inf),
    ],
    ids=["off by a half", "not a number", "another shape"],
)
def test_wrong_answer_fails(spoil: Any, error: float) -> None:
    result = run_check(COPY, Shifter(spoil), repeats=1)
    assert result.error == pytest.approx(error)
    assert not result.passed


def test_same_seed_draws_the_same_pictures_and_another_one_others() -> None:
    form = form_of(COPY)
    drawn = [form.cases(COPY, np.random.default_rng(seed), (8, 8)).pictures for seed in (1, 1, 2)]
    assert (drawn[0] == drawn[1]).all()
    assert not np.array_equal(drawn[0], drawn[2])


def test_template_without_a_check_is_refused() -> None:
    with pytest.raises(TemplateError, match=r"Template 'bare' has no check; name a closed form"):
        run_check(Template("bare", A=[[0.0]]), Shifter())


def test_unknown_closed_form_names_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match=r"Unknown closed form 'magic'.*: expected one of"):
        closed_form("magic")


@pytest.mark.parametrize(
    ("check", "message"),
    [
        (Check("shift"), "needs the parameters 'direction' and takes none, got none"),
        (Check("shift", (("direction", "east"), ("speed", 2.0))), "got 'direction', 'speed'"),
        (Check("shift", (("direction", "up"),)), "one of 'east', 'west', .*, got 'up'"),
        (Check("shift", (("direction", 1.0),)), "'direction' of its check must be a text"),
        (Check("threshold", (("threshold", "high"),)), "must be a number, got 'high'"),
        (Check("erosion", (("element", "##/##/##"),)), "must be three rows"),
        (Check("erosion", (("element", "..x/.../..."),)), "must be three rows"),
    ],
)
def test_wrong_parameters_are_named(check: Check, message: str) -> None:
    template = Template("t", A=[[0.0]], B=[[1.0]], boundary=-1.0, check=check)
    with pytest.raises(TemplateError, match=message):
        run_check(template, Shifter())


def test_digital_check_refuses_a_gray_boundary() -> None:
    template = Template("t", A=[[0.0]], B=[[1.0]], boundary=0.0, check=COPY.check)
    with pytest.raises(TemplateError, match="needs a boundary of -1, 1, 'zero-flux'"):
        run_check(template, Shifter())


def test_pattern_is_read_row_by_row_from_the_north() -> None:
    check = Check("hit-or-miss", (("pattern", "#o./.../..#"),))
    cells = pattern(Template("t", A=[[0.0]], check=check), "pattern")
    assert cells.tolist() == [["#", "o", "."], [".", ".", "."], [".", ".", "#"]]


def test_an_answer_just_beyond_the_tolerance_fails() -> None:
    tolerance = run_check(COPY, Shifter(), repeats=0).tolerance
    for factor, passed in ((0.9, True), (1.1, False)):
        spoilt = Shifter(lambda answer, off=factor * tolerance: answer + off)
        assert run_check(COPY, spoilt, repeats=0).passed is passed
