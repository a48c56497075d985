"""The half-space programs against their closed forms, which wrong covers fail."""

import pytest

from cnnum.engine import Engine
from cnnum.programs.library import get_program
from cnnum.templating.checks.program_run import run_program_check
from cnnum.templating.checks.tactile.halfspace import FORMS

WRONG = {
    "halfspace_stress": {"thickness": 1.01e-3},
    "halfspace_strain": {"thickness": 1.01e-3},
    "halfspace_layers": {"layers": 8},
    "halfspace_equilibrium": {"poisson": 0.4},
    "surface_load": {"likely": 3.1e3},
}
ENGINE = Engine()


class Bent:
    """A program whose last word on its parameters is another."""

    def __init__(self, program, parameters):
        self.program, self.parameters = program, parameters

    def bind(self, **parameters):
        return self.program.bind(**{**parameters, **self.parameters})


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.program)
def test_programs_pass_and_wrong_covers_fail(form):
    if ENGINE.name in form.too_slow:
        pytest.skip(
            f"no OpenCL device works here, and '{form.program}' is left out of {ENGINE.name}"
        )
    program = get_program(form.program)
    right = run_program_check(form, program, ENGINE)
    assert right.passed, (right.error, right.tolerance)
    wrong = run_program_check(form, Bent(program, WRONG[form.program]), ENGINE)
    assert wrong.error > form.tolerance


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.program)
def test_transforms_on_the_lattice_are_held_to_1e_5(form):
    assert form.name != "cover-transform" or form.tolerance <= 1e-5
