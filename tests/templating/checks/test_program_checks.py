"""Every tactile program with a closed form passes its check, as `cnnum templates check` runs it."""

import pytest

import cnnum
from cnnum.templating.checks.program_registry import checked_programs, program_forms
from cnnum.templating.checks.program_run import run_program_check

SLOW = ("halfspace_layers", "on_off", "slip", "surface_load", "tactile", "twist")
"""They take seconds each, and have tests of their own."""


@pytest.mark.one_in(4)
@pytest.mark.parametrize("name", [name for name in checked_programs() if name not in SLOW])
def test_a_program_is_right_on_frames_of_its_closed_form(name):
    """That of `texture` had a window of its own, and failed on every engine."""
    engine, program = cnnum.Engine("numba"), cnnum.get_program(name)
    for form in program_forms(name):
        assert run_program_check(form, program, engine, seed=1).passed, form.name
