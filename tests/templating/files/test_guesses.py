"""What a reader of another program's file guesses is said, and refused where that is asked for."""

import json
import logging

import pytest
from click.testing import CliRunner

import cnnum
from cnnum.cli import main
from cnnum.errors import TemplateError
from cnnum.templating.files import guessed, load_entries, load_entry
from cnnum.templating.library import get_entry, template_names

HEADER = "%Setting: Input:P, IniState:P, Boundary:Zero-flux\n"
FEEDBACK = "FEEDBACK 0 0 0 0 1 0 0 0 0\n"
SURPLUS = """FEEDBACK
0 0 0 0 0
0 0 0 0 0
0 0 2 0 0
0 0 0 0 0 0
0 0 0 0 0
"""
"""As in EDGEA.tem: 26 numbers for 25."""
RECORD = "EDGE_A = [0 0 0; 0 1 0; 0 0 0];\nEDGE_I = -1;\n"

CASES = {
    "a surplus number": ("mine.tem", HEADER + SURPLUS, "A, B", "26 numbers stand for 25"),
    "a bias map": (
        "mine.tem",
        "%Setting: Input:-, IniState:P1, Boundary:Fixed(0), BiasMap:P2\n" + FEEDBACK,
        "bias",
        "give it to each run, as 'bias='",
    ),
    "a mask": (
        "mine.tem",
        "%Setting: Input:-, IniState:P1, Boundary:Fixed(0), FixedStateMap:P2\n" + FEEDBACK,
        "mask",
        "give it to each run, as 'mask='",
    ),
    "two matrices": ("mine.tem", HEADER + FEEDBACK + FEEDBACK, "A", "are added"),
    "two biases": (
        "mine.tem", HEADER + FEEDBACK + "CURRENT 1\nCURRENT 2\n", "z", "the last one is taken",
    ),
    "two tables": (
        "mine.tem",
        HEADER + "NONLIN_FEEDBACK 0 0 0 0 a- 0 0 0 0\na 0 1 0 0\na 0 1 0 1\n",
        "nonlinear",
        "two tables",
    ),
    "a strange start": (
        "mine.tem", HEADER.replace("IniState:P", "IniState:Random") + FEEDBACK, "initial", "Random",
    ),
    "no start": ("mine.tem", "%Boundary: Fixed(1)\n" + FEEDBACK, "initial", "0 is taken"),
    "no boundary": ("mine.tem", "%IniState: 1\n" + FEEDBACK, "boundary", "no boundary is named"),
    "a strange boundary": (
        "mine.tem", HEADER.replace("Zero-flux", "Open") + FEEDBACK, "boundary", "'Open'",
    ),
    "a loop": (
        "mine.tem", HEADER + "LABEL 1\n" + FEEDBACK + "LOOP 1 5\n", "duration", "LOOP is not run",
    ),
    "a run's setting": ("mine.m", RECORD + "mCNN.Boundary = -1;\n", "boundary", "line 3"),
    "a bias of two": ("mine.m", RECORD.replace("-1;", "[-1 2];"), "z", "the first is taken"),
    "a key again": (
        "mine.cnnsim", "A 0 0 0 0 1 0 0 0 0\nC Constant 1\nZ 1\nZ 2\n", "z", "line 4: the key Z",
    ),
    "none in CNNSim": ("mine.cnnsim", "A 0 0 0 0 1 0 0 0 0\nZ 1\n", "boundary", "0 is taken"),
}  # fmt: skip


@pytest.mark.parametrize("what", CASES)
def test_each_guess_is_said_and_a_strict_reading_refuses_it(what, tmp_path, caplog):
    name, text, key, said = CASES[what]
    path = tmp_path / name
    path.write_text(text)
    with caplog.at_level(logging.WARNING, logger="cnnum"):
        entry = load_entry(path)
    real = [guess for guess in entry.guesses if not guess.always]
    assert [guess.key for guess in real] == [key]
    assert said in real[0].sentence
    assert str(path) in real[0].sentence
    assert caplog.messages == [real[0].sentence]
    with pytest.raises(TemplateError, match="A strict reading refuses this"):
        cnnum.load_template(path, strict=True)


def test_the_command_prints_them(tmp_path):
    path = tmp_path / "mine.tem"
    path.write_text(HEADER + SURPLUS)
    ask = ["templates", "import", str(path), "--to", str(tmp_path / "to")]
    said = CliRunner().invoke(main, ask)
    assert said.exit_code == 0, said.output
    plain = " ".join(said.stdout.split())
    assert "26 numbers stand for 25: '0 0' is taken for one 0." in plain
    assert "A .tem file names no duration" in plain
    strict = CliRunner().invoke(main, [*ask, "--strict", "--force"])
    assert strict.exit_code == 2
    record = json.loads(CliRunner().invoke(main, [*ask, "--force", "--json"]).stdout)
    assert len(record["guesses"]) == 1


def test_a_comment_answers_what_the_format_leaves_open(tmp_path):
    path = tmp_path / "mine.m"
    path.write_text(RECORD + "Boundary = -1;\n% cnnum: boundary = -1.0\n% cnnum: duration = 7.0\n")
    entry = load_entry(path, strict=True)
    assert (entry.template.boundary.constant, entry.template.duration) == (-1.0, 7.0)
    assert [guess.key for guess in entry.guesses] == ["initial"]


def test_another_picture_as_the_start_is_no_guess(tmp_path):
    path = tmp_path / "mine.tem"
    path.write_text(HEADER.replace("P,", "P1,", 1).replace("IniState:P", "IniState:P2") + FEEDBACK)
    assert cnnum.load_template(path, strict=True).needs_state
    path.write_text(HEADER + FEEDBACK)
    assert not cnnum.load_template(path, strict=True).needs_state


def test_a_delay_that_is_not_named_is_refused(tmp_path):
    path = tmp_path / "mine.tem"
    path.write_text(HEADER + FEEDBACK + "DELAYED_FEEDBACK 0 0 0 0 1 0 0 0 0\n")
    with pytest.raises(TemplateError, match="expected DELAY and a time"):
        load_entry(path)


def test_a_library_says_each_guess_once(tmp_path):
    path = tmp_path / "lib.m"
    path.write_text(RECORD + RECORD.replace("EDGE", "OTHER") + "IterNum = 50;\n")
    entries = load_entries(path)
    assert len(entries) == 2
    assert len(guessed(entries)) == 1


def test_templates_that_need_a_state_are_those_of_two_pictures():
    needing = {name for name in template_names() if cnnum.get_template(name).needs_state}
    assert {"LOGAND", "LOGOR", "FIGREC", "RECALL", "MATCNN_LOGAND"} <= needing
    ordinary = ("same picture", "from 0", "decided", "every layer", "goes to", "all black")
    for name in needing:
        entry = get_entry(name)
        assert entry.template.inputs == 1
        assert not entry.about.state.startswith(ordinary), name
