"""Finds of fuzzing: values that make no sense are refused in one sentence."""

import numpy as np
import pytest

import cnnum
from cnnum.errors import (
    ArrayError,
    CnnumError,
    MethodError,
    SizeError,
    TemplateError,
    UnknownNameError,
)
from cnnum.templating.functions import OutputFunction

HUGE = 10**400
EDGE = cnnum.get_template("EDGE")
PICTURE = np.ones((4, 4))


def run(**options):
    return cnnum.Engine("reference").run(EDGE, **{"input": PICTURE} | options)


@pytest.mark.parametrize(
    ("error", "options"),
    [
        (ArrayError, {"input": HUGE}),
        (MethodError, {"rtol": HUGE}),
        (MethodError, {"dt": HUGE}),
        (MethodError, {"dt": 5e-324}),
        (MethodError, {"duration": HUGE}),
        (MethodError, {"duration": np.zeros(3)}),
        (UnknownNameError, {"method": None}),
        (MethodError, {"method": ["euler"]}),
    ],
    ids=str,
)
def test_numbers_and_names_of_runs(error, options):
    with pytest.raises(error):
        run(**options)


@pytest.mark.parametrize(
    "parts",
    [
        {"z": HUGE},
        {"A": HUGE},
        {"boundary": None},
        {"boundary": HUGE},
        {"initial": None},
        {"duration": None},
        {"tau": 5e-324},
        {"output": ["standard"]},
    ],
    ids=str,
)
def test_numbers_and_names_of_templates(parts):
    with pytest.raises(CnnumError):
        cnnum.Template(**{"name": "odd", "A": [[1.0]]} | parts)


def test_a_mask_of_another_convention():
    mask = np.where(np.eye(4) > 0, 1.0, -1.0)
    with pytest.raises(ArrayError, match="mask < 0"):
        run(mask=mask)
    assert (run(mask=mask < 0).state[mask < 0] == EDGE.initial).all()


def test_discrete_time_has_no_time_constant():
    with pytest.raises(TemplateError, match="tau must be 1"):
        cnnum.Template("steps", [[1.0]], output="sign", tau=2.0)


def test_functions_of_one_name_have_plans_of_their_own():
    """Their OpenCL forms may be the same, and one may lie where another lay in memory."""
    engine, got = cnnum.Engine("reference"), []
    for factor in (2.0, 3.0):
        own = OutputFunction("own", lambda x, factor=factor: factor * x, "x")
        template = cnnum.Template("own", [[0.0]], output=own, initial=1.0, duration=0.0)
        got.append(engine.run(template, state=np.ones((1, 1))).output.item())
        del own, template
    assert got == [2.0, 3.0]


def test_an_error_is_one_line_however_long_what_came():
    with pytest.raises(MethodError) as raised:
        run(rtol=np.zeros((30, 30)))
    assert "\n" not in str(raised.value)
    assert len(str(raised.value)) <= 1500


def test_a_program_on_an_array_larger_than_the_machine():
    with pytest.raises(SizeError):
        cnnum.Engine("reference").compile(cnnum.get_program("contact"), (10**7, 10**7))
