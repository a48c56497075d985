"""Template files: their keys, and one sentence for each fault."""

from pathlib import Path

import numpy as np
import pytest

from cnnum.errors import TemplateError, TemplateFileError
from cnnum.templating.couplings import Gain
from cnnum.templating.files import load_entry, load_template, save_template
from cnnum.templating.functions import Table
from cnnum.templating.template import Check, Template

GOOD = """
name = "mine"
aliases = ["My Template"]
A = [[0, 1, 0], [1, 2, 1], [0, 1, 0]]
B = [[4.5]]
z = -1
boundary = "zero-flux"
input_boundary = -1
initial = "input"
duration = "settle"
output = "tanh"
description = "what it does"
source = "me"

[check]
name = "shadow"
direction = "west"
margin = 2
"""


COUPLED = """
name = "coupled"
A = [[[[1]], [[2]]], [[[3]], [[4]]]]
B = [[[[1]]], [[[0]]]]
output = "sign"

[[nonlinear]]
neighbour = "y"
weights = [[0, 1, 0], [1, 0, 1], [0, 1, 0]]
interpolation = "constant"
points = [[-1, 0.5], [1, -0.5]]

[[nonlinear]]
to = 1
source = 0
neighbour = "u"
centre = "x"
centre_source = 1
times_argument = true
reversed_sign = true
weights = [[1]]
interpolation = "linear"
points = [[0, 1]]

[[gain]]
to = 0
source = 1
interpolation = "linear"
points = [[0, 1], [2, 0]]

[delayed]
delay = 2.5
B = [[[[0.5]]], [[[0]]]]
"""


def write(folder: Path, text: str, name: str = "mine.toml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_every_key_reaches_the_template(tmp_path: Path) -> None:
    entry = load_entry(write(tmp_path, GOOD))
    template = entry.template
    assert entry.aliases == ("My Template",)
    assert template.name == "mine"
    assert template.A[0, 0].tolist() == [[0.0, 1.0, 0.0], [1.0, 2.0, 1.0], [0.0, 1.0, 0.0]]
    assert template.B.item() == 4.5
    assert template.z.item() == -1.0
    assert template.boundary.name == "zero-flux"
    assert template.input_boundary.constant == -1.0
    assert (template.initial, template.duration) == ("input", "settle")
    assert template.output.name == "tanh"
    assert (template.description, template.source) == ("what it does", "me")
    assert template.check == Check("shadow", (("direction", "west"), ("margin", 2.0)))


def test_name_and_feedback_are_enough(tmp_path: Path) -> None:
    template = load_template(write(tmp_path, 'name = "t"\nA = [[1]]'))
    assert template.inputs == 0
    assert template.digest == Template("t", A=[[1.0]]).digest


def test_layers_are_nested_as_to_from_row_column(tmp_path: Path) -> None:
    text = 'name = "t"\ntau = [1, 10]\nA = [[[[1]], [[2]]], [[[3]], [[4]]]]'
    template = load_template(write(tmp_path, text))
    assert template.A.shape == (2, 2, 1, 1)
    assert template.A[0, 1].item() == 2.0  # to layer 0 from layer 1
    assert template.tau.tolist() == [1.0, 10.0]


def test_every_key_of_the_couplings_reaches_the_template(tmp_path: Path) -> None:
    template = load_template(write(tmp_path, COUPLED))
    feedback, mixed = template.nonlinear
    assert feedback.weights.tolist() == [[0.0, 1.0, 0.0], [1.0, 0.0, 1.0], [0.0, 1.0, 0.0]]
    assert feedback.function == Table("constant", ((-1.0, 0.5), (1.0, -0.5)))
    assert (feedback.neighbour, feedback.centre, feedback.to) == ("y", None, 0)
    assert not feedback.times_argument
    assert not feedback.reversed_sign
    assert (mixed.neighbour, mixed.centre, mixed.times_argument) == ("u", "x", True)
    assert (mixed.to, mixed.source, mixed.centre_source, mixed.sign) == (1, 0, 1, -1.0)
    assert template.gains == (Gain(0, 1, Table("linear", ((0.0, 1.0), (2.0, 0.0)))),)
    assert template.delayed is not None
    assert template.delayed.delay == 2.5
    assert template.delayed.A.tolist() == np.zeros((2, 2, 1, 1)).tolist()
    assert template.delayed.B.ravel().tolist() == [0.5, 0.0]
    assert template.output.discrete


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("reversed_sign = true", "reversed = true", r"unknown key 'nonlinear\[1\].reversed'"),
        ('neighbour = "y"', "", r"the key 'nonlinear\[0\].neighbour' is missing"),
        (
            'neighbour = "y"',
            'neighbour = "v"',
            r"'nonlinear\[0\]' is wrong: A coupling must read 'x'",
        ),
        (
            "weights = [[1]]",
            "weights = [[1, 2]]",
            r"'nonlinear\[1\]' is wrong: .* must have the shape \(k, k\)",
        ),
        ("times_argument = true", "times_argument = 1", "times_argument' must be true or false"),
        ("to = 1", "to = -1", r"the key 'nonlinear\[1\].to' must be a whole number from 0 up"),
        ("to = 1", "to = 2", "a nonlinear coupling refers to a layer or input that does not exist"),
        ("[[0, 1]]", "[0, 1]", r"'nonlinear\[1\].points' must be a list of pairs"),
        ("[[0, 1]]", "[]", r"'nonlinear\[1\]' is wrong: The points of a function table"),
        ("[[-1, 0.5], [1, -0.5]]", "[[1, 0.5], [1, -0.5]]", "must have increasing arguments"),
        ('"constant"', '"cubic"', r"'nonlinear\[0\]' is wrong: .* must be 'constant' or 'linear'"),
        (
            "[[0, 1], [2, 0]]",
            "[[0, 1], [2]]",
            r"the key 'gain\[0\].points' must be a list of pairs",
        ),
        ("source = 1\ninter", "source = 7\ninter", "a gain refers to a layer that does not exist"),
        ("[[gain]]", "[gain]", r"the key 'gain' must be a list of tables \[\[gain\]\]"),
        ("delay = 2.5", "", "the key 'delayed.delay' is missing"),
        ("delay = 2.5", "delay = 0", "A delay must be above 0, in the unit of tau, got 0"),
        ("delay = 2.5", 'delay = "long"', "the key 'delayed.delay' must be a number"),
        ("[[[[0.5]]], [[[0]]]]", "[[0.5]]", "delayed A and B must couple its 2 layers"),
        ("[[[[0.5]]], [[[0]]]]", "[[0.5, 1], [0, 0]]", "'delayed' is wrong: .* with k odd"),
        ("[delayed]", "[[delayed]]", "the key 'delayed' must be a table"),
    ],
)
def test_error_names_the_key_of_a_coupling(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    assert old in COUPLED
    path = write(tmp_path, COUPLED.replace(old, new))
    with pytest.raises(TemplateError, match=message) as caught:
        load_template(path)
    assert str(caught.value).startswith(f"'{path}'")
    assert caught.value.__cause__ is None


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("z = -1", "zz = -1", "unknown key 'zz', expected one of name, A, B"),
        ('name = "mine"', "", "the key 'name' is missing"),
        ("A = [[0, 1, 0], [1, 2, 1], [0, 1, 0]]", "", "the key 'A' is missing"),
        ("[1, 2, 1]", "[1, 2]", "the key 'A' must have rows of equal length"),
        ("[1, 2, 1]", '[1, "2", 1]', "the key 'A' must be a number, got '2'"),
        ("[[4.5]]", "[[4, 5], [6, 7]]", r"B must have .* with k odd, got \(2, 2\)"),
        ("[[4.5]]", "[[]]", "the key 'B' must have rows of equal length, got a ragged or empty"),
        ("[[4.5]]", "4.5", "the key 'B' must be a matrix, as a list of rows, got 4.5"),
        ("[[4.5]]", "[4.5]", "the key 'B' must be a matrix of rows, .* got lists nested 1 deep"),
        ("[[4.5]]", "[[nan]]", "B of template 'mine' must be finite, got nan"),
        ("z = -1", "z = true", "the key 'z' must be a number, got True"),
        ("z = -1", 'z = ["a"]', "the key 'z' must be a number, got 'a'"),
        ("z = -1", f"z = 1{'0' * 400}", "a whole number of more than 64 bits"),
        ('name = "mine"', "name = 7", "the key 'name' must be a text, got 7"),
        ('["My Template"]', '"My Template"', "the key 'aliases' must be a list of names"),
        ('boundary = "zero-flux"', 'boundary = "open"', "Unknown boundary 'open'"),
        ('boundary = "zero-flux"', "boundary = []", "'boundary' must be a number or a text"),
        ('output = "tanh"', 'output = "relu"', "Unknown output function 'relu'"),
        ('"settle"', "-3", "duration must be a number of at least 0"),
        ('name = "shadow"', "", "the table 'check' needs the key 'name'"),
        ("margin = 2", "margin = [2]", "the key 'check.margin' must be a number or a text"),
        ("[check]", "[[check]]", "the key 'check' must be a table"),
        ("z = -1", "z = = 1", "is not valid TOML: .*line 6"),
        ("z = -1", f"z = {'[' * 5000}", "is not valid TOML"),
    ],
)
def test_error_names_the_file_and_the_key(old: str, new: str, message: str, tmp_path: Path) -> None:
    assert old in GOOD
    path = write(tmp_path, GOOD.replace(old, new))
    with pytest.raises(TemplateError, match=message) as caught:
        load_template(path)
    assert str(caught.value).startswith(f"'{path}'")
    assert caught.value.__cause__ is None


def test_missing_file_is_an_os_error_with_its_path(tmp_path: Path) -> None:
    with pytest.raises(TemplateFileError, match=r"nothing\.toml' cannot be read: No such file"):
        load_template(tmp_path / "nothing.toml")
    with pytest.raises(OSError, match="check the path"):
        load_template(tmp_path / "nothing.toml")


def test_unknown_suffix_names_the_known_ones(tmp_path: Path) -> None:
    path = write(tmp_path, GOOD, "mine.yaml")
    with pytest.raises(TemplateError, match=r"known suffix \('\.toml', .*\), got '\.yaml'"):
        load_template(path)
    with pytest.raises(TemplateError, match="known suffix"):
        save_template(Template("t", A=[[1.0]]), path)
    assert path.read_text(encoding="utf-8") == GOOD


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(b'name = "\xff"')
    with pytest.raises(TemplateError, match="must be UTF-8 text"):
        load_template(path)


def test_saving_replaces_the_file_whole_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = write(tmp_path, GOOD)
    template = Template("other", A=np.ones((3, 3)))
    with pytest.raises(TemplateFileError, match="already exists"):
        save_template(template, path)
    assert path.read_text(encoding="utf-8") == GOOD
    save_template(template, path, aliases=["Another"], force=True)
    entry = load_entry(path)
    assert (entry.template.digest, entry.aliases) == (template.digest, ("Another",))
    assert [item.name for item in tmp_path.iterdir()] == ["mine.toml"]


def test_failed_saving_leaves_the_old_file(tmp_path: Path) -> None:
    path = write(tmp_path, GOOD)
    with pytest.raises(TemplateError, match="surrogates not allowed"):
        save_template(Template("t", A=[[1.0]], description="\ud800"), path)
    with pytest.raises(TemplateError, match="none of them 'name'"):
        save_template(Template("t", A=[[1.0]], check=Check("x", (("name", 1.0),))), path)
    assert path.read_text(encoding="utf-8") == GOOD
    assert [item.name for item in tmp_path.iterdir()] == ["mine.toml"]


def test_saving_over_a_folder_or_into_none_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "folder.toml"
    folder.mkdir()
    for target in (folder, tmp_path / "none" / "mine.toml"):
        with pytest.raises(TemplateFileError, match="cannot be written"):
            save_template(Template("t", A=[[1.0]]), target)
    assert [item.name for item in tmp_path.iterdir()] == ["folder.toml"]
