"""`cnnum templates`: its lists, tables and checks."""

from dataclasses import fields

import numpy as np
import pytest

from cnnum import Check, Template, get_template, template_names
from cnnum.templating.checks import CheckResult
from cnnum.templating.files import Entry

ENGINES = ("opencl", "reference")


@pytest.fixture(autouse=True)
def two_engines(monkeypatch):
    """As if there were no other engine: the compilers of some take their time."""
    monkeypatch.setattr("cnnum.engines.registry.backend_names", lambda: ENGINES)


FIELDS = [field.name for field in fields(CheckResult)]
FIELDS = FIELDS[: FIELDS.index("reason") + 1]


def test_list_names_the_whole_library(call, records):
    found = records(call("templates", "list", "--json").stdout)
    assert [record["template"] for record in found] == list(template_names())
    edge = next(record for record in found if record["template"] == "EDGE")
    assert (edge["group"], edge["radius"], edge["inputs"]) == ("edges", 1, 1)
    table = call("templates", "list").stdout
    assert all(name in table for name in template_names())


def test_show_gives_the_numbers(call, records):
    (record,) = records(call("templates", "show", "edge", "--json").stdout)
    template = get_template("EDGE")
    np.testing.assert_array_equal(record["B"], template.B)
    np.testing.assert_array_equal(record["A"], template.A)
    assert record["z"] == template.z.tolist()
    assert record["boundary"] == "zero-flux"
    assert record["check"] == {"name": "edge"}
    assert "-1   8  -1" in call("templates", "show", "edge").stdout


def test_show_gives_every_coupling_and_function(call, records):
    (record,) = records(call("templates", "show", "D_ANISO", "--json").stdout)
    (coupling,) = record["nonlinear"]
    (known,) = get_template("D_ANISO").nonlinear
    np.testing.assert_array_equal(coupling["weights"], known.weights)
    assert [tuple(point) for point in coupling["points"]] == list(known.function.points)
    assert (coupling["neighbour"], coupling["times_argument"]) == ("x", True)
    text = call("templates", "show", "D_ANISO").stdout
    assert "f1(x of the cell - x of the neighbour) times its argument =" in text
    assert "f1: straight lines through (-2, 0), (-0.25, 0), (0, -1)" in text
    (record,) = records(call("templates", "show", "HERRING", "--json").stdout)
    assert record["delayed"]["A"][0][0][0] == [-0.1] * 5
    assert "A of 3 τ ago =" in call("templates", "show", "HERRING").stdout


def test_check_runs_on_every_engine(call, records, opencl):
    result = call("templates", "check", "EDGE", "smooth", "--json", "--repeats", 1)
    assert result.exit_code == 0, result.stderr
    found = records(result.stdout)
    pairs = [(record["template"], record["engine"]) for record in found]
    assert pairs == [(name, engine) for name in ("EDGE", "smooth") for engine in ENGINES]
    for record in found:
        assert list(record)[: len(FIELDS)] == FIELDS
        assert record["passed"]
        assert 0 <= record["error"] <= record["tolerance"]
        assert record["seconds"] > 0


def test_check_of_one_engine_as_a_table(call):
    result = call("templates", "check", "EDGE", "--engine", "reference", "--shape", "5x6")
    assert result.exit_code == 0, result.stderr
    assert "1 of 1 passed." in result.stdout
    assert "opencl" not in result.stdout


def test_a_failed_check_exits_with_1(call, records, monkeypatch):
    right = get_template("EDGE")
    weights = {"B": right.B, "z": right.z.tolist(), "boundary": right.boundary, "duration": 5.0}
    # the feedback of the wrong sign: no cell can hold its colour
    wrong = Template("EDGE", A=-right.A, check=Check("edge"), **weights)
    monkeypatch.setattr("cnnum.templating.library.get_entry", lambda name: Entry(wrong))
    arguments = ("templates", "check", "EDGE", "--engine", "reference", "--repeats", 1)
    result = call(*arguments, "--json")
    assert result.exit_code == 1, result.stderr
    (record,) = records(result.stdout)
    assert not record["passed"]
    assert record["error"] > record["tolerance"]
    assert "FAILED" in call(*arguments).stdout


def test_checks_that_an_engine_is_too_slow_for_are_named(call, records, opencl):
    names = ("halfspace_layers", "EDGE")
    result = call("templates", "check", *names, "--repeats", 1)
    assert result.exit_code == 0, result.stderr
    assert "3 of 3 passed." in result.stdout
    (line,) = (line for line in result.stdout.splitlines() if line.startswith("Left out"))
    assert line.startswith("Left out: halfspace_layers on reference (without modes ")
    assert "minutes" in line
    # as JSON nothing else is on standard output
    result = call("templates", "check", *names, "--repeats", 1, "--json")
    assert [(r["template"], r["engine"]) for r in records(result.stdout)] == [
        ("EDGE", "opencl"),
        ("EDGE", "reference"),
        ("halfspace_layers", "opencl"),
    ]
    assert result.stderr.strip() == line


@pytest.mark.parametrize("engine", ["numba", "reference"])
def test_a_named_engine_that_checks_nothing_is_an_error(call, engine):
    result = call("templates", "check", "halfspace_layers", "--engine", engine)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert f"'{engine}' cannot check halfspace_layers" in result.stderr
    assert "use one of opencl" in result.stderr
    both = call("templates", "check", "halfspace_layers", "--engine", "opencl", "--engine", engine)
    assert both.exit_code == 2


def test_a_program_without_a_check_says_so(call):
    result = call("templates", "check", "skeleton")
    assert result.exit_code == 2
    assert "'skeleton' has no check" in result.stderr


def test_slip_and_twist_are_checked(call, records, fast):
    names = ("slip", "twist", "tactile")
    result = call("templates", "check", *names, "--engine", fast.name, "--json")
    assert result.exit_code == 0, result.stderr
    found = records(result.stdout)
    assert {record["template"] for record in found} == set(names)
    assert all(list(record)[: len(FIELDS)] == FIELDS for record in found)


@pytest.mark.parametrize("columns", [80, 200])
def test_check_fits_the_terminal(call, monkeypatch, columns):
    monkeypatch.setattr("cnnum.cli.output.PIPED_WIDTH", columns)
    lines = call("templates", "check", "contact_dilation", "--repeats", 1).stdout.splitlines()
    assert max(map(len, lines)) <= columns
    rows = [line for line in lines if "contact_dilation" in line]
    assert len(rows) == len(ENGINES)  # no name is broken over two lines
    assert ("closed form" in lines[1]) == (columns == 200)
