"""Templates are found by words and by an example, and two are compared."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from scipy import ndimage

import cnnum
from cnnum.cli import main
from cnnum.design.finding import compare, find_by_example, find_by_words
from cnnum.errors import ArrayError


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        ("fill holes", {"HOLE"}),
        ("skeletonization", {"SKEL", "MATCNN_SKEL"}),
        ("sobel", {"EDGE", "EDGEGRAY", "GRADIENT"}),
        ("median filter", {"MEDIAN"}),
        ("remove isolated points", {"FIGDEL", "FIGREM", "SMKILLER", "PA_PB"}),
        ("logical and", {"LOGAND"}),
        ("game of life", {"LIFE_1", "LIFE"}),
        ("corner detection", {"CORNER"}),
    ],
)
def test_words_of_users_find_it(words, wanted):
    names = [hit.name.upper() for hit in find_by_words(words)]
    assert any(name.startswith(tuple(wanted)) for name in names[:5]), names


def test_words_that_nothing_has_find_nothing():
    assert find_by_words("quaternion zeppelin") == []
    assert find_by_words("the of in") == []


def random_pictures(seed=0):
    return np.where(np.random.default_rng(seed).random((3, 16, 16)) < 0.5, 1.0, -1.0)


def test_an_example_finds_what_makes_it():
    """The wanted pictures are SciPy's: the erosion by the four neighbours, and the edges left."""
    given = random_pictures()
    cross = ndimage.generate_binary_structure(2, 1)
    inner = np.stack([ndimage.binary_erosion(p > 0, cross, border_value=1) for p in given])
    names = ["EROSION", "EDGE", "DILATION", "LOGNOT", "CORNER", "SHADOW", "AVERAGE", "MEDIAN"]
    names = [name for name in names if name in cnnum.template_names()]
    edges = np.where((given > 0) & ~inner, 1.0, -1.0)
    rim = np.zeros_like(edges, bool)
    rim[:, 1:-1, 1:-1] = True
    found = find_by_example(given, np.where(rim, edges, np.nan), names=names)
    assert found[0].wrong < found[1].wrong
    assert found[0].cells == rim.sum()
    inverted = find_by_example(given, -given, names=names)
    assert (inverted[0].name, inverted[0].wrong) == ("LOGNOT", 0)


def test_examples_that_are_none():
    with pytest.raises(ArrayError, match="same shape"):
        find_by_example(np.zeros((3, 3)), np.zeros((3, 4)))
    with pytest.raises(ArrayError, match="so it asks for nothing"):
        find_by_example(np.zeros((3, 3)), np.full((3, 3), np.nan))


def test_two_rules_differ_where_arithmetic_says():
    """The bias of EDGE decides how many white neighbours an edge needs: counted by hand."""
    edge = cnnum.get_template("EDGE")
    other = replace(edge, name="edge2", z=float(np.ravel(edge.z)[0]) - 2.0)
    found = compare(edge, other)
    weights, bits = edge.B[0, 0], np.arange(512)[:, None] >> np.arange(9) & 1
    pictures = np.where(bits.reshape(512, 3, 3) == 1, 1.0, -1.0)
    drive = (pictures * weights).sum(axis=(1, 2))
    # A of the centre is 1: from state 0 the sign is that of the drive
    first, second = drive + np.ravel(edge.z)[0] > 0.0, drive + np.ravel(other.z)[0] > 0.0
    assert found.exhaustive
    assert (found.cases, found.unlike) == (512, int((first != second).sum()))
    assert set(found.differs) == {"z"}
    same = compare(edge, edge)
    assert (same.unlike, same.differs) == (0, {})
    coupled = compare(cnnum.get_template("HOLE"), cnnum.get_template("EDGE"))
    assert not coupled.exhaustive
    assert coupled.unlike > 0


def test_the_commands(tmp_path):
    run = CliRunner().invoke
    said = run(main, ["templates", "find", "fill", "holes", "--json"])
    assert said.exit_code == 0
    assert json.loads(said.stdout.splitlines()[0])["template"].upper().startswith("HOLE")
    said = run(main, ["templates", "compare", "EROSION", "DILATION"])
    assert said.exit_code == 0, said.output
    assert "of 512 neighbourhoods" in said.stdout
    for wrong in ([], ["x", "--input", __file__], ["--input", __file__]):
        assert run(main, ["templates", "find", *wrong]).exit_code == 2
