"""The closed forms of checks hold for any time constant."""

from dataclasses import replace

import numpy as np
import pytest

import cnnum
from cnnum.errors import TemplateError
from cnnum.templating.checks.records import Case
from cnnum.templating.checks.running import run_check

ENGINES = ("opencl", "numba", "reference")


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("tau", [0.25, 2.0])
def test_a_check_holds_for_any_time_constant(engine, tau):
    """DIFFUS with τ = 2 failed on all engines: its closed form was that of τ = 1.

    Steps of rates that jump were 0.01 long for any τ (MIN), and HERRING's form held for times from
    one delay to two, which τ moves.
    """
    used = cnnum.Engine(engine)
    names = ("DIFFUS", "MIN")
    if engine == "numba":
        names = (*names, "ECHO", "FADING", "HERRING", "MATCNN_BPF", "MEDIAN")
    for name in names:
        template = cnnum.get_template(name)
        whole = template.duration if template.duration == "settle" else tau * template.duration
        template = replace(template, tau=tau, duration=whole)
        assert run_check(template, used, repeats=0).passed, name


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("tau", [2e-7, 1e5])
def test_an_array_rests_at_the_same_state_for_any_time_constant(engine, tau):
    """Runs gave up after 1,000 units of time: after 0.01 τ, or had too many steps to be counted."""
    weights = np.array([[0.0, 0.2, 0.0], [0.2, 0.3, 0.1], [0.0, 0.2, 0.0]])
    template = cnnum.Template("slow", weights, z=0.1, tau=tau)
    # all weights are small, so that cells stay below 1 and rest at the solution of a linear system
    size = 4
    couples = np.zeros((size * size, size * size))
    for row, col in np.ndindex(size, size):
        for down, right in np.ndindex(3, 3):
            there = row + down - 1, col + right - 1
            if min(there) >= 0 and max(there) < size:
                couples[row * size + col, there[0] * size + there[1]] = weights[down, right]
    want = np.linalg.solve(np.eye(size * size) - couples, np.full(size * size, 0.1))
    assert want.max() < 1.0
    for method in ("auto", "euler"):
        got = cnnum.Engine(engine).run(template, state=np.zeros((size, size)), method=method)
        assert got.settled, method
        assert np.abs(got.state.ravel() - want).max() <= got.error + 1e-12, method
        assert got.error < 1e-6, method


NAMED = ("delay", "slow", "quick", "receptor", "surround", "adapting")
"""Parameters of checks that are times, in the unit of τ."""


@pytest.mark.parametrize("scale", [0.3, 2.0])
def test_a_check_holds_where_every_time_is_longer(scale):
    """The forms of receptors took the layer that is their signal to have τ = 1."""
    for name in ("on_off_layers", "rapid_receptor", "vibration_receptor", "HERRING", "LOGDIFNF"):
        template = cnnum.get_template(name)
        times = {key: v * scale if key in NAMED else v for key, v in template.check.parameters}
        late = template.delayed and replace(template.delayed, delay=scale * template.delayed.delay)
        slower = replace(
            template, tau=scale * template.tau, duration=scale * template.duration, delayed=late,
            check=replace(template.check, parameters=tuple(times.items())),
        )  # fmt: skip
        assert run_check(slower, cnnum.Engine("numba"), repeats=0).passed, name


def test_time_is_counted_in_time_constants():
    slow = cnnum.Template("slow", [[0.0]], tau=4.0, duration=6.0)
    assert (Case().time(slow), Case().length(slow)) == (1.5, 6.0)
    assert Case(duration=2.0).time(slow) == 0.5


def test_times_are_shown_as_so_many_time_constants_only_where_these_are_1():
    """A duration of 5 with τ = 2 was shown as 5 τ."""
    template = cnnum.get_template("EDGE")
    assert template.timed(template.duration) == "5 τ"
    slow = replace(template, tau=2.0)
    assert slow.timed(slow.duration) == "5 (unit of τ)"
    assert "5 (unit of τ)" in slow._repr_html_()


def test_layers_of_their_own_time_constants_have_no_such_form():
    mixed = cnnum.Template("mixed", [[[[0.0]], [[0.0]]]] * 2, tau=[1.0, 2.0], duration=1.0)
    with pytest.raises(TemplateError, match="layers with one time constant"):
        Case().time(mixed)
