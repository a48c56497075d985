"""Code in an M-file that only MATLAB could run is refused, and lines that say numbers are read."""

import numpy as np
import pytest

import cnnum
from cnnum.errors import TemplateError
from cnnum.templating.files import load_entry

EDGE = "EDGE_A = [0 0 0; 0 1 0; 0 0 0];\nEDGE_B = [-1 -1 -1; -1 8 -1; -1 -1 -1];\nEDGE_I = -1;\n"


def read(tmp_path, text, name="lib.m"):
    path = tmp_path / name
    path.write_text(text)
    return cnnum.load_template(path)


@pytest.mark.parametrize(
    "code",
    [
        "if false\nEDGE_I = -7;\nend\n",
        "for k = 1:3\n  EDGE_I = k;\nend\n",
        "  while true, EDGE_I = 2; end\n",
        "switch x\ncase 1\nEDGE_I = 1;\nend\n",
        "function y = f(x)\n",
        "eval('EDGE_I = 3');\n",
        "x = 3; if x > 4, EDGE_I = -7; end\n",
        "do\nEDGE_I = -7;\nuntil true\n",
        "disp(1), exit\n",
    ],
)
def test_code_is_refused_with_its_line(tmp_path, code):
    with pytest.raises(TemplateError, match=r"line 4: expected only assignments"):
        read(tmp_path, EDGE + code)


def test_comments_hold_no_values(tmp_path):
    block = "%{\nEDGE_I = -7;\nif false\n%}\n% EDGE_I = 5;\n"
    octave = read(tmp_path, EDGE + block.replace("%", "#"), "octave.m")
    assert octave.z.tolist() == [-1.0]
    template = read(tmp_path, EDGE + block)
    assert template.z.tolist() == [-1.0]
    with pytest.raises(TemplateError, match="line 9"):
        read(tmp_path, EDGE + block + "EDGE_B = [1 2; 3];\n")


def test_what_stands_after_an_inner_block_is_still_a_comment(tmp_path):
    block = "%{\n%{\nEDGE_I = -6;\n%}\nEDGE_I = -7;\n%}\n"
    assert read(tmp_path, EDGE + block).z.tolist() == [-1.0]
    assert read(tmp_path, EDGE + block + "EDGE_I = -2;\n", "after.m").z.tolist() == [-2.0]


@pytest.mark.parametrize("end", ["\r\n", "\r"])
@pytest.mark.parametrize("suffix", [".tem", ".m", ".cnnsim", ".toml"])
def test_an_editor_of_windows_changes_no_template(tmp_path, suffix, end):
    """Such an editor writes a mark at the start of the file and other ends of lines."""
    path, edited = tmp_path / f"plain{suffix}", tmp_path / f"edited{suffix}"
    cnnum.save_template("HOLE", path)
    text = path.read_text(encoding="utf-8")
    if suffix == ".m":
        text += "%{\nHOLE_I = -7;\n%}\n"
    edited.write_bytes(text.replace("\n", end).encode("utf-8-sig"))
    assert load_entry(edited) == load_entry(path)


@pytest.mark.parametrize(
    ("line", "part", "place", "value"),
    [
        ("EDGE_A(2,2) = 2;", "A", (1, 1), 2.0),
        ("EDGE_A( 2 , 2 )=2.5", "A", (1, 1), 2.5),
        ("EDGE_B(1, 3) = -4e-1;", "B", (0, 2), -0.4),
    ],
)
def test_an_element_that_is_set_counts(tmp_path, line, part, place, value):
    template = read(tmp_path, EDGE + line + "\n")
    plain = read(tmp_path, EDGE, "plain.m")
    wanted = getattr(plain, part)[0, 0].copy()
    wanted[place] = value
    np.testing.assert_array_equal(getattr(template, part)[0, 0], wanted)


@pytest.mark.parametrize(
    "line",
    ["EDGE_A(4,2) = 2;", "EDGE_A(0,1) = 2;", "EDGE_A(2) = 2;", "EDGE_A(:,1) = 2;",
     "EDGE_A(2,2) = [1 2];",
     "OTHER_A(1,1) = 2;", "EDGE_A(end,1) = 2;", "EDGE_A(2,2) += 1;", "EDGE_A{2,2} = 9;",
     "EDGE_A *= 2;", "EDGE_I++;", "EDGE_A.x = 7;", "[EDGE_A, x] = deal(2);"],
)  # fmt: skip
def test_elements_that_cannot_be_set_are_refused(tmp_path, line):
    with pytest.raises(TemplateError, match="line 4"):
        read(tmp_path, EDGE + line + "\n")


def test_a_line_that_goes_on_is_one(tmp_path):
    text = EDGE.replace("0 1 0; 0 0 0", "0 1 ... own feedback\n 0; 0 0 0") + "EDGE_B = [1 2; 3];\n"
    with pytest.raises(TemplateError, match="line 5"):
        read(tmp_path, text)
    template = read(tmp_path, text.rpartition("EDGE_B")[0], "whole.m")
    np.testing.assert_array_equal(template.A[0, 0], [[0, 0, 0], [0, 1, 0], [0, 0, 0]])


@pytest.mark.parametrize("key", ["BiasMap", "Bias Map", "bias map", "BIASMAP"])
def test_a_bias_map_that_a_header_asks_for_is_told(tmp_path, key):
    text = f"%Setting: Input:-, IniState:P1, Boundary:Zero-flux, {key}:P2\nneighborhood: 1\n"
    path = tmp_path / "own.tem"
    path.write_text(text + "feedback:\n0 1 0\n1 0 1\n0 1 0\ncurrent: 0\n")
    assert "bias map: P2" in load_entry(path).template.description
    assert load_entry(path).about.state == "P1"
