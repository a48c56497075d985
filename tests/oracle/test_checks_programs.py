"""Programs against their closed forms, and closed forms that a wrong program fails."""

from collections.abc import Mapping

import pytest

from cnnum.checks.program_registry import checked_programs, program_forms
from cnnum.checks.program_run import run_program_check
from cnnum.engine import Engine
from cnnum.program_library import get_program

FORMS = [form for name in checked_programs() for form in program_forms(name)]
WRONG = {
    "outline-strain": {"depth": 1.9},
    "outline-stress": {"push": 1.0},
    "no-edge": {"rise": 2.0},
    "centroid": {"push": 1.0},
    "bump-loads": {"share": 0.9},
    "all-bits": {"push": 1.0},
    "friction-and-roughness": {"ratio": 0.5},
}
"""Parameters that make a program wrong for its form."""


class Bent:
    """A program whose last word on its parameters is another."""

    def __init__(self, program, parameters: Mapping[str, object]):
        self.program, self.parameters = program, parameters

    def bind(self, **parameters):
        return self.program.bind(**{**parameters, **self.parameters})


@pytest.mark.parametrize("shape", [(8, 8), (16, 16)])
@pytest.mark.parametrize("form", [f for f in FORMS if f.name in WRONG], ids=lambda form: form.name)
def test_programs_pass(form, shape):
    result = run_program_check(form, get_program(form.program), Engine("opencl"), shape=shape)
    assert result.passed, (result.error, result.tolerance)
    assert (result.template, result.check) == (form.program, form.name)
    assert result.seconds > 0


@pytest.mark.parametrize("form", [f for f in FORMS if f.name in WRONG], ids=lambda form: form.name)
def test_wrong_programs_fail(form):
    wrong = Bent(get_program(form.program), WRONG[form.name])
    result = run_program_check(form, wrong, Engine("opencl"))
    assert not result.passed
    assert result.error > form.tolerance
