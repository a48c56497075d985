"""What goes out to a terminal, and standard streams that are closed or full."""

import io
import json
import os
import subprocess
import sys

import pytest
from rich.text import Text

from cnnum.cli import output
from cnnum.cli.output import Output, facts, table
from cnnum.safety.values import visible, visible_json

CLEAN = pytest.mark.promise(
    "Control characters in names of files, arrays and keys never reach the terminal."
)
STREAMS = pytest.mark.promise("Standard streams that are closed or full change no exit code.")
CONTROLS = [*range(0x20), *range(0x7F, 0xA0), 0x061C, 0x200E, 0x200F, *range(0x202A, 0x202F)]
CONTROLS += range(0x2066, 0x206A)
HOSTILE = (
    "".join(f"a{chr(code)}" for code in CONTROLS if chr(code) not in "\n\t\r") + "\x1b]0;x\x07 τ°é"
)


def controls_of(text):
    return {sign for sign in text if ord(sign) in CONTROLS} - set("\n\t")


@CLEAN
def test_every_control_character_is_replaced_and_no_other():
    assert not controls_of(visible(HOSTILE))
    assert visible(HOSTILE).endswith("\ufffd]0;x\ufffd τ°é")
    assert visible("a\tb\nτ°é±") == "a\tb\nτ°é±"
    text = visible_json(json.dumps({"name": HOSTILE}, ensure_ascii=False))
    assert not controls_of(text)
    assert json.loads(text) == {"name": HOSTILE}


@CLEAN
@pytest.mark.parametrize("terminal", [False, True])
def test_tables_text_and_records_are_clean(capsys, monkeypatch, terminal):
    monkeypatch.setattr(output, "on_terminal", lambda: terminal)
    made = table("name", HOSTILE[:20], title=HOSTILE)
    made.add_row(HOSTILE, Text(HOSTILE))
    Output(False).show(made, facts([(HOSTILE, HOSTILE)], HOSTILE), HOSTILE)
    Output(False).record({}, HOSTILE)
    Output(True).record({"name": HOSTILE})
    out = capsys.readouterr().out
    assert "]0;x" in out
    assert not controls_of(out)


@CLEAN
def test_names_in_files_and_of_files_are_clean(call, tmp_path):
    name = "\x1b]0;x\x07\u202e"
    (tmp_path / f"{name}.toml").write_text("needs = 1")
    (tmp_path / "scene.toml").write_text(f'needs = ["{chr(0x9B)}2J\u202e"]\n"\\u001bX" = 1\n')
    for words in (("plan", tmp_path / f"{name}.toml"), ("plan", tmp_path / "scene.toml"),
                  ("replay", tmp_path / f"{name}.mcap"), ("plan", name), (name,)):  # fmt: skip
        done = call(*words)
        assert done.exit_code == 2
        assert not controls_of(done.stderr + done.stdout)


def run(words, streams):
    code = (
        f"import os, sys\nfor n in {streams!r}: os.close(n)\n"
        f"os.execv(sys.executable, [sys.executable, '-m', 'cnnum', *{words!r}])"
    )
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)


@STREAMS
@pytest.mark.parametrize("streams", [(1,), (2,), (0, 1, 2)])
@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("templates", "show", "EDGE"), 0),
        (("templates", "show", "EDGE", "--json"), 0),
        (("templates", "show", "EDGR"), 2),
    ],
)
def test_a_stream_that_is_closed_changes_no_exit_code(words, code, streams):
    done = run(words, streams)
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    assert "cnnum:" not in done.stdout  # a sentence is for standard error alone


@STREAMS
def test_what_is_printed_never_lands_in_a_file_that_is_written(tmp_path):
    """The first file that is opened would get the number of standard output."""
    target = tmp_path / "t.html"
    words = ("templates", "show", "EDGE", "--engine", "reference", "--transient", str(target))
    assert run(words, (1, 2)).returncode == 0
    assert target.read_text().startswith("<!doctype html>")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="this system has no /dev/full")  # noqa: PTH110
@STREAMS
def test_a_full_standard_output_is_one_sentence():
    with open("/dev/full", "w") as full:  # noqa: PTH123
        done = subprocess.run(
            [sys.executable, "-m", "cnnum", "templates", "show", "EDGE"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    assert done.returncode == 2
    assert done.stderr == "cnnum: No space left on device.\n"


def test_nowhere_is_a_stream():
    from cnnum.cli.root import _Nowhere

    print("text", file=_Nowhere(), flush=True)
    assert isinstance(_Nowhere(), io.TextIOBase)
