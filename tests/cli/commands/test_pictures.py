"""Picture files in and out, and transients that can be seen."""

from xml.etree import ElementTree

import numpy as np
import pytest
from scipy import ndimage

import cnnum

image = pytest.importorskip("PIL.Image")
PICTURE = np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, 0.5]])


def test_a_picture_comes_back_within_a_grey_level(tmp_path):
    for suffix in ("png", "bmp", "tiff"):
        cnnum.save_picture(PICTURE, tmp_path / f"p.{suffix}")
        back = cnnum.load_picture(tmp_path / f"p.{suffix}")
        assert np.abs(back - PICTURE).max() <= 1 / 255  # half a level of 2/255
    cnnum.save_picture(PICTURE, tmp_path / "large.png", scale=4)
    assert cnnum.load_picture(tmp_path / "large.png").shape == (8, 12)


def test_black_is_plus_one_and_what_is_transparent_is_white(tmp_path):
    pixels = np.zeros((1, 3, 4), dtype=np.uint8)
    pixels[0, :, 3] = (255, 0, 255)  # black, transparent, white
    pixels[0, 2, :3] = 255
    image.fromarray(pixels).save(tmp_path / "p.png")
    assert cnnum.load_picture(tmp_path / "p.png").tolist() == [[1.0, -1.0, -1.0]]
    assert cnnum.as_picture(np.array([[0, 255]], dtype=np.uint8)).tolist() == [[1.0, -1.0]]


@pytest.mark.parametrize(
    ("call_it", "said"),
    [
        (lambda at: cnnum.load_picture(at / "none.png"), "cannot be read: No such file"),
        (lambda at: cnnum.load_picture(at / "text.png"), "not an image that Pillow reads"),
        (lambda at: cnnum.save_picture(PICTURE, at / "p.nothing"), "cannot be written"),
        (lambda at: cnnum.save_picture(PICTURE, at / "no" / "p.png"), "cannot be written"),
        (lambda at: cnnum.save_picture(np.zeros(3), at / "p.png"), "needs .rows, cols."),
        (lambda at: cnnum.as_picture(PICTURE), "type bool or uint8"),
    ],
)
def test_what_is_no_picture_is_one_sentence(tmp_path, call_it, said):
    (tmp_path / "text.png").write_text("hello")
    with pytest.raises(cnnum.CnnumError, match=said):
        call_it(tmp_path)


def test_a_transient_as_a_page_a_strip_and_a_moving_picture(call, tmp_path):
    for suffix in ("html", "png", "gif"):
        out = tmp_path / f"hole.{suffix}"
        arguments = ("--transient", out, "--times", 5, "--engine", "numba")
        done = call("templates", "show", "HOLE", *arguments)
        assert done.exit_code == 0, done.stderr
        assert f"Written: {out}" in done.stdout
    text = (tmp_path / "hole.html").read_text()
    assert text.count("<svg") == 5
    assert ">0 τ<" in text
    assert "http" not in text
    with image.open(tmp_path / "hole.gif") as moving:
        assert moving.n_frames > 1
        first = np.asarray(moving.convert("L"))
        moving.seek(moving.n_frames - 1)
        assert (np.asarray(moving.convert("L")) < 128).sum() != (first < 128).sum()


def test_a_picture_file_is_the_input(call, tmp_path):
    dot = -np.ones((9, 9))
    dot[3:6, 3:6] = 1.0
    cnnum.save_picture(dot, tmp_path / "dot.png")
    out = tmp_path / "edge.png"
    options = ("--transient", out, "--input", tmp_path / "dot.png", "--times", 2)
    assert call("templates", "show", "EDGE", *options, "--engine", "numba").exit_code == 0
    last = np.asarray(image.open(out))[:, -126:]  # 9 cells of 14 pixels
    black = (last[7::14, 7::14] < 128).astype(int)
    assert black.sum() == 8
    assert black[4, 4] == 0


def test_a_figure_for_a_paper_has_the_numbers_and_the_answer_as_shapes(call, tmp_path):
    """Painted cell by cell, the last map is the picture with its hole filled, as SciPy fills it."""
    picture = -np.ones((9, 9))
    picture[2:7, 1:7], picture[4, 3:5] = 1.0, -1.0
    cnnum.save_picture(picture, tmp_path / "ring.png")
    out = tmp_path / "hole.svg"
    options = ("--transient", out, "--input", tmp_path / "ring.png", "--engine", "numba")
    assert call("templates", "show", "HOLE", *options).exit_code == 0
    tags = list(ElementTree.parse(out).iter())
    written = [float(tag.text) for tag in tags if tag.get("class") == "number"]
    hole = cnnum.get_template("HOLE")
    assert written == [*hole.A.ravel(), *hole.B.ravel(), *hole.z]
    shapes = [tag for tag in tags if tag.get("fill")]
    x, y, width = (np.array([float(s.get(key)) for s in shapes]) for key in ("x", "y", "width"))
    size = float(shapes[0].get("height"))
    painted = np.zeros((9, 63))  # seven maps, 16 units apart
    for shape, left, top, wide in zip(shapes, x, y, width, strict=True):
        at = int(left // (9 * size + 16.0))
        col = round((left - at * (9 * size + 16.0)) / size) + 9 * at
        painted[round((top - y.min()) / size), col : col + round(wide / size)] = (
            shape.get("fill") == "#000000"
        )
    truth = ndimage.binary_fill_holes(picture > 0)
    np.testing.assert_array_equal(painted[:, -9:] > 0, truth)
    assert painted[:, :9].all()  # HOLE begins black everywhere


def test_a_film_of_a_run_has_the_events_beside_it(call, tmp_path):
    """One picture for each frame of a slow array, and one sentence for what is no film."""
    out = tmp_path / "run.gif"
    given = ("--frames", 30, "--set", "array.rate=20", "--engine", "numba")
    done = call("run", "contact", *given, "--film", out)
    assert done.exit_code == 0, done.stderr
    assert str(out) in done.stdout
    with image.open(out) as moving:
        lasts = 0
        for number in range(moving.n_frames):
            moving.seek(number)
            lasts += moving.info["duration"]
    assert lasts == 30 * 50  # pictures that are equal are stored as one
    done = call("run", "contact", "--film", tmp_path / "run.avi")
    assert (done.exit_code, done.stdout) == (2, "")
    assert "kind of film" in done.stderr


@pytest.mark.parametrize("name", ["t.wav", "no/t.html"])
def test_what_cannot_be_written_is_said_before_anything(call, name):
    done = call("templates", "show", "HOLE", "--transient", name)
    assert (done.exit_code, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
