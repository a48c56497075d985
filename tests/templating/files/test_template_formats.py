"""Files of other programs: every feature of their grammar, their dirty data, their errors."""

import numpy as np
import pytest

from cnnum.errors import TemplateError
from cnnum.templating.files import load_entry, load_template, load_templates
from cnnum.templating.library import get_template

HOLE = """\
%Function: Fills holes
%TemLibName: HOLE
%CNNModel: Single-layer, CT-CNN
%Setting: Input:P, IniState:1, Boundary:Fixed(-1)
neighborhood 1
Feedback:
0 1 0   1 3 1
0 1 .0
CONTROL   % the input holds objects
0 0 0
0 4 0
0 0 0
comment anything at all FEEDBACK
CURRENT: -1
\x1a"""


def read(tmp_path, text, name="mine.tem"):
    path = tmp_path / name
    path.write_bytes(text.replace("\n", "\r\n").encode("cp1250"))
    return path


def test_a_linear_file_is_the_librarys_template(tmp_path):
    entry = load_entry(read(tmp_path, HOLE))
    hole = get_template("HOLE")
    np.testing.assert_array_equal(entry.template.A, hole.A)
    np.testing.assert_array_equal(entry.template.B, hole.B)
    assert entry.template.z == [-1.0]
    # the headers of the library's files are often the same
    assert (entry.template.name, entry.template.boundary.constant) == ("mine", -1.0)
    assert entry.template.source == "imported from mine.tem (HOLE)"
    assert load_template(read(tmp_path, HOLE, "hole.tem")).name == "HOLE"
    assert entry.template.initial == 1.0
    assert entry.about.input == "P"


def test_functions_may_follow_their_use(tmp_path):
    text = """%Setting: Input:P, IniState:P, Boundary:Zero-flux
NEIGHBORHOOD 1
FEEDBACK
0 0 0 0 2 0 0 0 0
NONLIN_CONTROL
a- a- a-
a- 0 a-
a- a- a-
CURRENT .7
a 0 3 -0.18 .5 0.18 -1 1 0.5
"""
    template, contour = load_template(read(tmp_path, text)), get_template("CONTOUR")
    (got,), (wanted,) = template.nonlinear, contour.nonlinear
    assert got.function == wanted.function
    assert (got.neighbour, got.centre) == ("u", "u")
    np.testing.assert_array_equal(got.weights, wanted.weights)
    assert template.initial == "input"
    assert template.boundary == contour.boundary


def test_a_nonlinear_matrix_may_hold_plain_weights_and_functions_of_the_neighbour(tmp_path):
    text = "NONLIN_FEEDBACK 0 0 0 0 a0 2 0 0 0 a 1 2 -1 -1 1 1"
    template = load_template(read(tmp_path, text))
    assert template.A[0, 0, 1, 2] == 2.0
    (coupling,) = template.nonlinear
    assert (coupling.neighbour, coupling.centre) == ("y", None)
    assert coupling.function.interpolation == "linear"


@pytest.mark.parametrize(
    ("argument", "centre", "neighbour", "factor"),
    [
        ("x-u#", "x", "u", False),
        ("x-x#x-x", "x", "x", True),
    ],
)
def test_generalised_d(tmp_path, argument, centre, neighbour, factor):
    text = f"NEIGHBORHOOD 1\nNONLIN_D\n{argument}\n0 d 0\nd 0 d\n0 d 0\nd 1 2 -1 -1 1 1\n"
    (coupling,) = load_template(read(tmp_path, text)).nonlinear
    found = (coupling.centre, coupling.neighbour, coupling.times_argument)
    assert found == (centre, neighbour, factor)
    assert coupling.weights.sum() == 4.0


def test_delays(tmp_path):
    text = "CONTROL 0 0 0 0 1.5 0 0 0 0\nDELAYED_CONTROL 0 0 0 1.5 0 0 0 0 0\nDELAY 10\nCURRENT -2"
    template = load_template(read(tmp_path, text))
    assert template.delayed is not None
    assert template.delayed.delay == 10.0
    np.testing.assert_array_equal(template.delayed.B, get_template("MOTDEPEN").delayed.B)


def test_a_colon_may_stand_anywhere_behind_a_keyword(tmp_path):
    spread = load_template(read(tmp_path, HOLE))
    close = HOLE.replace("neighborhood 1", "Neighborhood:1").replace("CURRENT: -1", "current:-1")
    template = load_template(read(tmp_path, close.replace("CONTROL ", "Control :")))
    assert template.digest == spread.digest


def test_layers_with_names_and_a_radius_of_each(tmp_path):
    text = """NEIGHBORHOOD 1
NRLAYERS 2
LAYER 1 counts the neighbours
FEEDBACK FROM 2
1 1 1 1 0 1 1 1 1
CURRENT 3
LAYER 2
NEIGHBORHOOD 2
FEEDBACK FROM 1
0 0 0 0 0  0 0 0 0 0  0 0 2 0 0  0 0 0 0 0  0 0 0 0 0
CONTROL FROM 1
1
"""
    template = load_template(read(tmp_path, text))
    assert (template.layers, template.inputs, template.radius) == (2, 1, 2)
    assert template.A[0, 1].sum() == 8.0
    assert template.A[1, 0, 2, 2] == 2.0
    assert template.z.tolist() == [3.0, 0.0]
    assert template.B[1, 0, 2, 2] == 1.0


def test_dirty_data_is_read_as_it_is_meant(tmp_path):
    wide = "NEIGHBORHOOD 1\nFEEDBACK\n" + "0 0 0 0 0\n" * 2 + "0 0.5 2 0.5 0\n"
    wide += "0 0 0 0 0 0\n" + "0 0 0 0 0\n"
    template = load_template(read(tmp_path, wide))  # 26 numbers under a radius of 1
    assert template.radius == 2
    assert template.A[0, 0, 2].tolist() == [0.0, 0.5, 2.0, 0.5, 0.0]


def test_a_program_in_time_is_several_templates(tmp_path):
    part = "TEMPLATE 1\nFEEDBACK 0 0 0 0 {} 0 0 0 0\nCURRENT -1\n"
    path = read(tmp_path, "LABEL 1\n" + part.format(4) + "NEW\n" + part.format(6) + "LOOP 1 8\n")
    found = load_templates(path)
    assert [template.A[0, 0, 1, 1] for template in found] == [4.0, 6.0]
    with pytest.raises(TemplateError, match="program of 2 templates"):
        load_template(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("FEEDBACK\n0 0 0\n0 1 0\n0 0\n", "line 4: expected a square matrix of odd size"),
        ("NEIGHBORHOOD 1\nCURRENT many\n", "line 2: expected the bias after CURRENT, got 'many'"),
        ("CURRENT", "line 1: expected the bias after CURRENT, got the end of the file"),
        ("NEIGHBORHOOD 1.5", "line 1: expected the radius .* got 1.5"),
        ("LAYER 0\nCURRENT 1", "line 1: expected a layer from 1 up, got 0"),
        ("NONLIN_FEEDBACK 0 0 0 0 a- 0 0 0 0", "line 1: expected a table of the function 'a'"),
        ("\n\nWEIGHTS 1", "line 3: expected a keyword or a function's letter, got 'WEIGHTS'"),
        ("% nothing\n", "line 1: expected FEEDBACK, CONTROL or CURRENT, got no template"),
        ("CURRENT 1\na 2 1 0 0", "line 2: expected the interpolation of function 'a'"),
        ("NONLIN_D\nz#\n", "line 2: expected an argument such as 'x-u#'"),
        ("NEIGHBORHOOD 0\nNONLIN_D x-u#\n)", "line 3: expected a weight or a letter of NONLIN_D"),
        ("NRLAYERS 2\nFEEDBACK FROM 5 1", "line 2: expected a layer from 1 to 2, got 5"),
    ],
)
def test_a_broken_file_names_its_line(tmp_path, text, message):
    with pytest.raises(TemplateError, match=message) as caught:
        load_template(read(tmp_path, text))
    assert "mine.tem" in str(caught.value)


def test_matcnn_tables_read_neighbour_less_centre(tmp_path):
    path = tmp_path / "temlib.m"
    path.write_text(
        "% MatCNN\nMEDIAN_A = [0 0 0; 0 1 0; 0 0 0];\nMEDIAN_Dd = 0.5*ones(3);\n".replace(
            "0.5*ones(3)", "[.5 .5 .5; .5 0 .5; .5 .5 .5]"
        )
        + "MEDIAN_d = [0 2 0 -1 2.5 1 12];\nMEDIAN_I = 0;\nEDGE_A = [0 0 0\n0 2 0\n0 0 0];\n"
    )
    median, edge = load_templates(path)
    (coupling,), (wanted,) = median.nonlinear, get_template("MATCNN_MEDIAN").nonlinear
    assert coupling.physics[1:] == wanted.physics[1:]
    np.testing.assert_array_equal(coupling.weights, wanted.weights)
    assert edge.A[0, 0, 1, 1] == 2.0
    with pytest.raises(TemplateError, match="holds 2 templates"):
        load_template(path)


MATCNN_FILE = """\
MEAN_B = 1/8 * [1 1 1;
                1 0 1;
                1 1 1];
HALF_A = 0.5*[1 2 1
              0 0 0
              1 2 1];
HALF_I = -.25;
LATE_A = [2 4 2; 0 0 0; 2 4 2]/4 ;   % the same
LATE_I = HALF_I;
SAME_A = HALF_A
STEP_Dd = [0 1 0; 1 0 1; 0 1 0];
STEP_d = [0 3  -0.5 0  0.5 1  -2.5 0  12];
"""


def test_matcnn_values_have_factors_and_names(tmp_path):
    path = tmp_path / "temlib.m"
    path.write_text(MATCNN_FILE)
    mean, half, late, same, step = load_templates(path)
    assert mean.B[0, 0].tolist() == [[0.125] * 3, [0.125, 0.0, 0.125], [0.125] * 3]
    assert half.A[0, 0, 0].tolist() == [0.5, 1.0, 0.5]
    for one in (late, same):
        np.testing.assert_array_equal(one.A, half.A)
    assert late.z.tolist() == half.z.tolist() == [-0.25]
    # the last step ends nowhere, so that its lost sign does no harm
    assert step.nonlinear[0].function.points[-1] == (2.5, 0.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("A = 1;", "line 1: expected a matrix such as"),
        ("\nX_A = Y_A;", "line 2: expected a value above, got 'Y_A'"),
        ("X_A = 1/0*[1];", "line 1: expected a matrix with a factor such as"),
        ("X_A = 2+[1];", "line 1: expected a matrix with a factor such as"),
        ("X_A = [1 0 0;\n0 1 0;", r"line 1: expected a number, or a matrix from '\[' to '\]'"),
        ("X_Dd = [1];\nX_d = [1 2 0 0 -1 0 12];", "line 2: .* must have increasing arguments"),
        ("\nX_A = [1 2; 3];", "line 2: expected rows of equal length"),
        ("X_Bb = [1];\nX_b = [nan 1];", "line 2: expected finite numbers"),
        ("X_A = [1 b];", "line 1: expected numbers, got 'b'"),
        ("X_Dd = [1];\nX_d = [0 1 0 0 99];", "line 2: .* code of a D table must be like 12"),
    ],
)
def test_a_broken_matcnn_file_names_its_line(tmp_path, text, message):
    path = tmp_path / "temlib.m"
    path.write_text(text)
    with pytest.raises(TemplateError, match=message):
        load_template(path)


def test_cnnsim_files_have_no_suffix(tmp_path):
    path = tmp_path / "pattern"
    path.write_text("A 0 0 0 0 1 0 0 0 0\nB 0 -1 1 -1 1 -1 1 -1 0\nZ -4\nBoundary Constant -1\n")
    template = load_template(path)
    assert (template.name, template.boundary.constant) == ("pattern", -1.0)
    path.write_text("A 0 0 0\n0 1 0\n0 0\nZ -4\n")
    with pytest.raises(TemplateError, match=r"line 4: expected nine numbers of A, got 'Z'"):
        load_template(path)
    path.write_text("A 0 0 0 0 1 0 0 0 0\nC Mirror\n")
    with pytest.raises(TemplateError, match=r"line 2: expected Constant, ZeroFlux or Periodic"):
        load_template(path)
