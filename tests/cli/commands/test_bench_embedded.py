"""`cnnum bench embedded`: wrong options, and one program counted."""

import json
import os
from dataclasses import replace

import pytest

from cnnum.cli.output import fitted, table
from cnnum.lab.bench.page import cell
from cnnum.lab.bench.records import as_row
from cnnum.lab.commands.bench import SPARES
from cnnum.lab.embedded.cortex_m import missing_tools
from tests.embedded.test_costs import ROW


@pytest.mark.parametrize(
    ("option", "value"), [("--core", "m5"), ("--clock", "fast"), ("--ram", "0"), ("--shape", "9")]
)
def test_wrong_options_are_refused_in_one_sentence(call, option, value):
    result = call("bench", "embedded", option, value)
    assert result.exit_code == 2
    assert value in result.stderr


def test_a_narrow_terminal_keeps_that_in_which_rows_differ():
    known = as_row(replace(ROW, case="mindlin_slip", instructions=6_715_023))
    first, *others = known
    whole = table(first, *(f">{name}" for name in others))
    whole.add_row(*(cell(value) for value in known.values()))
    _, gone = fitted(whole, 80, SPARES["embedded"])
    assert gone
    assert not {"case", "shape", "precision", "method", "instructions", "error"} & {*gone}


@pytest.mark.skipif("CNNUM_FRAMES" not in os.environ, reason="make embedded")
@pytest.mark.skipif(bool(missing_tools()), reason="needs the extra 'embedded'")
def test_twist_is_counted(call):
    result = call(
        "bench", "embedded", "--quick", "--program", "twist", "--precision", "q15", "--shape",
        "4x4x3", "--ram", "1k", "--json",
    )  # fmt: skip
    row, _, answer = (json.loads(line) for line in result.stdout.splitlines())
    assert row["wrong"] == 0
    assert row["frames_per_s"] == 168e6 / row["instructions"]
    assert row["error"] < 0.1
    assert "none is within" in answer["answers"][0]
