"""`cnnum bench embedded`: wrong options, and one program counted."""

import json
import os

import pytest

from cnnum.lab.embedded.cortex_m import missing_tools


@pytest.mark.parametrize(
    ("option", "value"), [("--core", "m5"), ("--clock", "fast"), ("--ram", "0"), ("--shape", "9")]
)
def test_wrong_options_are_refused_in_one_sentence(call, option, value):
    result = call("bench", "embedded", option, value)
    assert result.exit_code == 2
    assert value in result.stderr


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
