"""Programs against their closed forms, and closed forms that a wrong program fails."""

from collections.abc import Mapping

import pytest

from cnnum.engine import Engine
from cnnum.programs.library import get_program, program_names
from cnnum.templating.checks.program_registry import checked_programs, program_forms
from cnnum.templating.checks.program_run import run_program_check

FORMS = [form for name in checked_programs() for form in program_forms(name)]
WRONG = {
    "outline-strain": {"depth": 1.9},
    "outline-stress": {"push": 1.0},
    # any load that ends within two cells is taken for an edge
    "no-edge": {"sharp": 0.5},
    "centroid": {"push": 1.0},
    "bump-loads": {"share": 0.9},
    "all-bits": {"push": 1.0},
    "friction-and-roughness": {"ratio": 0.5},
    "slip-strength": {"look": 0.1},
    "slip-report": {"false_reports": 0.5},
    "slip-pads": {"pads": 1},
    "twist-strength": {"floor": 120.0},
    "twist-report": {"floor": 1e5},
    "ramp-and-hold": {"ra1_to": 51.0},
    "spikes-of-a-leaky-cell": {"membrane": 0.011},
    "drifting-grating": {"rate": 103.0},
    "correlated-grating": {"delay": 0.15},
    "centre-and-surround": {"surround": 0.032},
    # it is on its way when the frames end
    "one-of-two-bodies": {"speed": 2.0},
    "slip-and-twist": {"slip_false_reports": 0.5},
}
"""Parameters that make a program wrong for its form."""

FORMS_HERE = [form for form in FORMS if form.name in WRONG]

BUILT_LONG = {"tactile"}
"""Programs whose kernels take long to build; tests/tactile/test_sizes.py has their sizes."""

OF_ONE_SIZE = {"outline-stress", "no-edge"}
"""Forms of edges, for which as much is to be built: `outline-strain` has the other size, and
tests/tactile/test_edges.py more of both."""

RUNS = [(form, (8, 8)) for form in FORMS_HERE] + [
    (form, (16, 16))
    for form in FORMS_HERE
    if form.program not in BUILT_LONG and form.name not in OF_ONE_SIZE
]


class Bent:
    """A program whose last word on its parameters is another."""

    def __init__(self, program, parameters: Mapping[str, object]):
        self.program, self.parameters = program, parameters

    def bind(self, **parameters):
        return self.program.bind(**{**parameters, **self.parameters})


def engine_for(form):
    """The engine that users get; the test is skipped where that is too slow for the form."""
    engine = Engine()
    if engine.name in form.too_slow:
        pytest.skip(
            f"no OpenCL device works here, and '{form.program}' is left out of {engine.name}"
        )
    return engine


def test_every_tactile_program_has_a_check():
    assert set(checked_programs()) == set(program_names("tactile"))


def test_engines_that_are_left_out_have_a_reason():
    some = [form for form in FORMS if form.too_slow]
    assert {form.program for form in some} == {"halfspace_layers", "halfspace_equilibrium"}
    assert all(form.left_out for form in some)


@pytest.mark.one_in(5)
@pytest.mark.parametrize("name", ["slip-report", "slip-pads", "twist-report"])
@pytest.mark.parametrize("engine", ["numba", "reference"])
def test_streams_pass_on_other_engines(name, engine):
    (form,) = (form for form in FORMS if form.name == name)
    result = run_program_check(form, get_program(form.program), Engine(engine), repeats=0)
    assert result.passed, (result.error, result.tolerance)


@pytest.mark.parametrize(("form", "shape"), RUNS, ids=lambda it: getattr(it, "name", str(it)))
def test_programs_pass(form, shape):
    result = run_program_check(form, get_program(form.program), engine_for(form), shape=shape)
    assert result.passed, (result.error, result.tolerance)
    assert (result.template, result.check) == (form.program, form.name)
    assert type(result.passed) is bool
    assert result.seconds > 0


@pytest.mark.parametrize("form", [f for f in FORMS if f.name in WRONG], ids=lambda form: form.name)
def test_wrong_programs_fail(form):
    wrong = Bent(get_program(form.program), WRONG[form.name])
    # another kernel to build takes longer than few frames without
    engine = engine_for(form) if form.program in BUILT_LONG else Engine("numba")
    result = run_program_check(form, wrong, engine, repeats=0)
    assert not result.passed
    assert result.error > form.tolerance
