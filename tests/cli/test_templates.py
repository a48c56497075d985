"""`cnnum templates`: what it lists, shows and checks."""

import numpy as np
import pytest

from cnnum import Check, Template, get_template, template_names

ENGINES = ("opencl", "reference")


@pytest.fixture(autouse=True)
def two_engines(monkeypatch):
    """As if there were no other engine: the compilers of some take their time."""
    monkeypatch.setattr("cnnum.engines.backend.backend_names", lambda: ENGINES)


FIELDS = (
    "template",
    "engine",
    "precision",
    "method",
    "check",
    "error",
    "tolerance",
    "seconds",
    "passed",
)


def test_list_names_the_whole_library(call, records):
    found = records(call("templates", "list", "--json").stdout)
    assert [record["template"] for record in found] == list(template_names())
    edge = next(record for record in found if record["template"] == "EDGE")
    assert (edge["group"], edge["radius"], edge["inputs"]) == ("classic", 1, 1)
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


def test_check_runs_on_every_engine(call, records):
    result = call("templates", "check", "EDGE", "smooth", "--json", "--repeats", 1)
    assert result.exit_code == 0, result.stderr
    found = records(result.stdout)
    pairs = [(record["template"], record["engine"]) for record in found]
    assert pairs == [(name, engine) for name in ("EDGE", "smooth") for engine in ENGINES]
    for record in found:
        assert tuple(record)[: len(FIELDS)] == FIELDS
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
    monkeypatch.setattr("cnnum.library.get_template", lambda name: wrong)
    arguments = ("templates", "check", "EDGE", "--engine", "reference", "--repeats", 1)
    result = call(*arguments, "--json")
    assert result.exit_code == 1, result.stderr
    (record,) = records(result.stdout)
    assert not record["passed"]
    assert record["error"] > record["tolerance"]
    assert "FAILED" in call(*arguments).stdout


@pytest.mark.parametrize("columns", [80, 200])
def test_check_fits_the_terminal(call, monkeypatch, columns):
    monkeypatch.setattr("cnnum.cli.output.PIPED_WIDTH", columns)
    lines = call("templates", "check", "contact_dilation", "--repeats", 1).stdout.splitlines()
    assert max(map(len, lines)) <= columns
    rows = [line for line in lines if "contact_dilation" in line]
    assert len(rows) == len(ENGINES)  # no name is broken over two lines
    assert ("closed form" in lines[1]) == (columns == 200)
