"""Templates are found by words and by an example, and two are compared."""

import json
import signal
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from scipy import ndimage

import cnnum
from cnnum.cli import main
from cnnum.design import finding
from cnnum.design.finding import compare, find_by_example, find_by_words, find_programs
from cnnum.errors import ArrayError, UnknownNameError
from cnnum.templating.library import get_entry


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


def test_tags_narrow_a_search_and_are_one_by_themselves():
    names = [hit.name for hit in find_by_words("", 300, tags=["logic"])]
    assert {"LOGAND", "LOGNOT"} <= set(names)
    assert all("logic" in get_entry(name).about.tags for name in names)
    both = find_by_words("edge", 300, tags=["gray"])
    assert both
    assert all("gray" in get_entry(hit.name).about.tags for hit in both)
    assert both[0].score == 1.0
    with pytest.raises(UnknownNameError, match="skeleton"):
        find_by_words("", tags=["skeletn"])


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
    found = find_by_example(given, np.where(rim, edges, np.nan), names=names, most=2)
    assert found[0].wrong < found[1].wrong
    assert found[0].cells == rim.sum()
    inverted = find_by_example(given, -given, names=names, most=1)
    assert (inverted[0].name, inverted[0].wrong) == ("LOGNOT", 0)


FEW = ["CHUA_EROSION", "CHUA_DILATION", "EDGE", "LOGNOT", "LOGDIF", "CORNER", "RETINA_1"]
"""Of uncoupled cells but the last, which has several layers."""


def test_a_program_of_two_is_found():
    """SciPy's opening by a cross: no template of these makes it, and erosion and dilation do."""
    given = random_pictures(4)
    cross = ndimage.generate_binary_structure(2, 1)
    opened = np.stack([ndimage.binary_opening(p > 0, cross) for p in given])
    wanted = np.where(opened, 1.0, -1.0)
    assert find_by_example(given, wanted, names=FEW)[0].wrong > 0
    first, second, *_ = find_programs(given, wanted, names=FEW)
    assert (first.wrong, first.cells) == (0, given.size)
    assert first.templates == ("CHUA_EROSION", "CHUA_DILATION")
    margins = [get_entry(name).measured.margin for name in first.templates]
    assert first.margin == min(margins)
    assert second.wrong > 0


def test_the_second_of_a_program_may_read_the_given_picture_too():
    """What an erosion takes away is the given picture without the eroded one."""
    given = random_pictures(5)
    cross = ndimage.generate_binary_structure(2, 1)
    eroded = np.stack([ndimage.binary_erosion(p > 0, cross) for p in given])
    outline = np.where((given > 0) & ~eroded, 1.0, -1.0)
    names = ["CHUA_EROSION", "LOGDIF", "LOGNOT", "CHUA_DILATION"]
    best = find_programs(given, outline, names=names)[0]
    assert (best.templates, best.wrong) == (("CHUA_EROSION", "LOGDIF"), 0)
    # the input of LOGDIF is taken from its state, as the library says
    assert best.name == "CHUA_EROSION → LOGDIF (state: the given picture)"


def spiral(side=16):
    """A black wall one cell wide, round a white way into the middle and open at its end."""
    cells, row, col = -np.ones((side, side)), 1, 1
    cells[row, col] = 1.0
    lengths = [side - 3, side - 3, side - 3, *(n for k in range(side - 5, 0, -2) for n in (k, k))]
    for way, length in enumerate(lengths):
        down, right = ((0, 1), (1, 0), (0, -1), (-1, 0))[way % 4]
        for _ in range(length):
            row, col = row + down, col + right
            cells[row, col] = 1.0
    return cells


@pytest.mark.parametrize("closed", [False, True])
def test_a_search_waits_for_waves_that_take_their_time(closed):
    """HOLE's wave goes round for more than 32 time constants, and SciPy says where it ends."""
    given = spiral()
    if closed:
        given[2, 1] = 1.0  # nothing leads out now
    filled = np.where(ndimage.binary_fill_holes(given > 0), 1.0, -1.0)
    assert (filled > given).any() is np.bool_(closed)
    run = cnnum.Engine("numba").run("HOLE", input=given[np.newaxis], duration=32.0)
    late = ((run.output[0] > 0) != (filled > 0)).any()
    assert late or closed
    outputs = {}
    found = find_by_example(given, filled, names=["HOLE", "EDGE"], outputs=outputs)
    assert (found[0].name, found[0].wrong) == ("HOLE", 0)
    np.testing.assert_array_equal(outputs["HOLE"] > 0, filled > 0)


def test_the_best_results_are_those_of_a_run(monkeypatch):
    """If fixed steps take CORNER for right, its second run shows that it is not."""
    given = random_pictures(7)
    truth = cnnum.Engine("numba").run("EDGE", input=given).output
    quick = finding._quickly

    def wrong(engine, template, *maps):
        return truth if template.name == "CORNER" else quick(engine, template, *maps)

    monkeypatch.setattr(finding, "_quickly", wrong)
    for most in (1, 2):
        found = find_by_example(given, truth, names=["CORNER", "EDGE"], most=most)
        assert [match.name for match in found] == ["EDGE", "CORNER"]
        corner = cnnum.Engine("numba").run("CORNER", input=given).output
        assert found[1].wrong == int(((corner > 0) != (truth > 0)).sum()) > 0


def test_a_search_ends_early_with_the_best_so_far():
    given = random_pictures(4)
    cross = ndimage.generate_binary_structure(2, 1)
    opened = np.stack([ndimage.binary_opening(p > 0, cross) for p in given])
    wanted, seen = np.where(opened, 1.0, -1.0), []

    def two(name):
        seen.append(name)
        return len(seen) <= 2

    assert {m.name for m in find_by_example(given, wanted, names=FEW, watch=two)} == set(FEW[:2])
    seen.clear()
    outputs = {}
    find_by_example(given, wanted, names=FEW, outputs=outputs)

    def until_dilation(name):
        seen.append(name)
        return seen.count("CHUA_DILATION") < 2 or name == "CHUA_DILATION"

    best = find_programs(given, wanted, names=FEW, watch=until_dilation, outputs=outputs)
    assert best[0].templates == ("CHUA_EROSION", "CHUA_DILATION")
    assert {match.templates[1] for match in best} <= {"CHUA_EROSION", "CHUA_DILATION"}


def test_examples_that_are_none():
    with pytest.raises(ArrayError, match="same shape"):
        find_by_example(np.zeros((3, 3)), np.zeros((3, 4)))
    with pytest.raises(ArrayError, match="so it specifies nothing"):
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


def test_templates_of_two_pictures_are_compared_from_both_states():
    """AND and OR differ where input and state do: for half of 512 neighbourhoods and two states."""
    found = compare(cnnum.get_template("LOGAND"), cnnum.get_template("LOGOR"))
    assert found.exhaustive
    assert (found.cases, found.unlike) == (1024, 512)
    assert (found.states[:, 1, 1] != found.inputs[:, 1, 1]).all()
    assert found.differs.keys() == {"z"}


def test_what_is_known_without_a_run_stands_beside():
    found = compare(cnnum.get_template("EDGE"), cnnum.get_template("HOLE"))
    edge, hole = found.figures
    assert (edge.stability, hole.stability) == ("monostable cells", "symmetric A")
    assert (edge.products, edge.once, hole.products, hole.once) == (1, 9, 5, 1)
    assert hole.margin == get_entry("HOLE").measured.margin
    assert hole.settle == get_entry("HOLE").measured.settle[-1][1]
    other = replace(cnnum.get_template("HOLE"), z=-0.9)  # not the one that was measured
    assert compare(other, other).figures[0].margin is None
    layers = compare(cnnum.get_template("RETINA_1"), cnnum.get_template("EDGE"))
    assert (layers.cases, layers.unlike) == (0, 0)
    assert "A" in layers.differs


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_a_comparison_is_a_picture(suffix, tmp_path):
    path = tmp_path / f"pair{suffix}"
    ask = ["templates", "compare", "CHUA_EROSION", "EDGE", "--picture", str(path)]
    said = CliRunner().invoke(main, ask)
    assert said.exit_code == 0, said.output
    assert "stability" in said.stdout
    assert "margin of the bias" in said.stdout
    if suffix == ".png":
        shown = cnnum.load_picture(path)
        assert min(shown.shape) > 300
        assert 0.02 < (shown > 0).mean() < 0.9
    else:
        assert "Their answers differ in" in path.read_text()
        assert CliRunner().invoke(main, ask).exit_code == 2  # only a PNG says that cnnum made it
    ask[-1] = str(tmp_path / "pair.doc")
    assert CliRunner().invoke(main, ask).exit_code == 2


def test_the_command_finds_programs_where_no_template_fits(tmp_path, monkeypatch):
    monkeypatch.setattr("cnnum.design.finding.template_names", lambda: tuple(FEW))
    given = random_pictures(6)[0]
    opened = ndimage.binary_opening(given > 0, ndimage.generate_binary_structure(2, 1))
    files = [str(tmp_path / name) for name in ("given.png", "wanted.png", "same.png")]
    for file, picture in zip(files, (given, np.where(opened, 1.0, -1.0), -given), strict=True):
        cnnum.save_picture(picture, file)

    def found(wanted, *more):
        ask = ["templates", "find", "--input", files[0], "--wanted", wanted, "--json", *more]
        said = CliRunner().invoke(main, ask)
        assert said.exit_code == 0, said.output
        return [json.loads(line)["templates"] for line in said.stdout.splitlines()]

    assert found(files[1])[0] == ["CHUA_EROSION", "CHUA_DILATION"]
    # an interrupt while templates run keeps what there is
    quick, calls = finding._quickly, []

    def interrupted(*given):
        calls.append(given)
        if len(calls) == 3:
            signal.raise_signal(signal.SIGINT)
        return quick(*given)

    # a shell that starts tests in the background lets them ignore it
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    with monkeypatch.context() as patch:
        patch.setattr(finding, "_quickly", interrupted)
        ask = ["templates", "find", "--input", files[0], "--wanted", files[1]]
        said = CliRunner().invoke(main, ask)
    signal.signal(signal.SIGINT, before)
    assert (said.exit_code, len(calls)) == (130, 3)
    assert "these are the best so far" in said.stderr
    assert sum(name in said.stdout for name in FEW) == 3
    assert all(len(names) == 1 for names in found(files[1], "--no-programs"))
    assert found(files[2])[0] == ["LOGNOT"]


def test_the_commands(tmp_path):
    run = CliRunner().invoke
    said = run(main, ["templates", "find", "fill", "holes", "--json"])
    assert said.exit_code == 0
    assert json.loads(said.stdout.splitlines()[0])["template"].upper().startswith("HOLE")
    said = run(main, ["templates", "compare", "EROSION", "DILATION"])
    assert said.exit_code == 0, said.output
    assert "of 512 neighbourhoods" in said.stdout
    for wrong in ([], ["x", "--input", __file__], ["--input", __file__], ["x", "--programs"]):
        assert run(main, ["templates", "find", *wrong]).exit_code == 2


def test_couplings_are_compared_in_words():
    said = CliRunner().invoke(main, ["templates", "compare", "EXTREME", "EDGE"])
    assert "straight lines through (-3, -2)" in said.output
    assert "none" in said.output
    assert "NonlinearCoupling" not in said.output
