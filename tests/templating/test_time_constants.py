"""The closed forms of checks hold for any time constant."""

from dataclasses import replace

import pytest

import cnnum
from cnnum.errors import TemplateError
from cnnum.templating.checks.records import Case
from cnnum.templating.checks.run import run_check

ENGINES = ("opencl", "numba", "reference")


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("tau", [0.25, 2.0])
def test_a_check_holds_for_any_time_constant(engine, tau):
    """DIFFUS with τ = 2 failed on all engines: its closed form was that of τ = 1."""
    used = cnnum.Engine(engine)
    names = ("DIFFUS", "ECHO", "FADING", "MATCNN_BPF") if engine == "numba" else ("DIFFUS",)
    for name in names:
        template = replace(cnnum.get_template(name), tau=tau)
        assert run_check(template, used).passed


def test_time_is_counted_in_time_constants():
    slow = cnnum.Template("slow", [[0.0]], tau=4.0, duration=6.0)
    assert (Case().time(slow), Case().length(slow)) == (1.5, 6.0)
    assert Case(duration=2.0).time(slow) == 0.5


def test_layers_of_their_own_time_constants_have_no_such_form():
    mixed = cnnum.Template("mixed", [[[[0.0]], [[0.0]]]] * 2, tau=[1.0, 2.0], duration=1.0)
    with pytest.raises(TemplateError, match="layers with one time constant"):
        Case().time(mixed)
