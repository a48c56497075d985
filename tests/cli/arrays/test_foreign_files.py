"""Twelve files as other programs write them: a layout, its check and the right event, by nobody."""

import numpy as np
import pytest
from foreign_files import FILES, FRAMES, PRESSED, RATE

import cnnum

THREE = """
needs = ["contact"]
[array]
driver = "simulated"
[engine]
name = "numba"
[program]
name = "contact"
[program.parameters]
push = 1.0
reads = "force"
"""
ONE = """
needs = ["onset"]
[array]
driver = "simulated"
[engine]
name = "numba"
[program]
name = "on_off"
[program.parameters]
push = 1.0
"""


@pytest.fixture(params=FILES)
def foreign(request, tmp_path):
    """A file, and what its user knows and it does not say."""
    make, known = FILES[request.param]
    return make(tmp_path), known


def test_a_layout_is_proposed_and_reads_the_file(call, records, foreign):
    path, known = foreign
    done = call("layout", path, "--write", "--json", *known)
    assert done.exit_code == 0, done.stderr
    (said,) = (one for one in records(done.stdout) if one["kind"] == "layout")
    assert (said["frames"], said["written"]) == (FRAMES, str(path.with_suffix(".toml")))
    recording = cnnum.load_recording(path)
    assert recording.rate == pytest.approx(RATE, rel=1e-3)
    rows, cols = recording.shape
    pads = 2 if path.name == "pads.npy" else 1
    moved = np.abs(recording.values[-1] - np.median(recording.values[:90], axis=0))[..., -1]
    row, col = np.argwhere(moved == moved[:, : cols // pads].max())[0]
    # the centre of the press, in rows and columns
    assert row == pytest.approx(0.6 * rows - 0.5, abs=1.0)
    assert col % (cols // pads) == pytest.approx(0.4 * cols / pads - 0.5, abs=1.0)
    shown = call("check", path, "--json")
    assert shown.exit_code == 0, shown.stdout
    sentences = {one["what"]: one["sentence"] for one in records(shown.stdout)}
    assert "as the times say" in sentences["rate"]
    pattern = len(recording.channels) == 3 and rows > 2
    assert ("orders and signs are right" in sentences["order"]) == pattern
    again = call("layout", path, "--write", *known)
    assert again.exit_code == 2
    assert "already exists" in again.stderr


@pytest.mark.one_in(3)
def test_the_event_comes_without_an_edit_by_hand(call, records, foreign, tmp_path):
    path, known = foreign
    assert call("layout", path, "--write", *known).exit_code == 0
    scene = tmp_path / "scene.toml"
    three = len(cnnum.load_recording(path).channels) == 3
    scene.write_text(THREE if three else ONE)
    first, *rest = records(call("replay", path, "--scene", scene, "--json").stdout)
    assert first["kind"] == ("contact" if three else "onset")
    assert PRESSED < first["t"] < PRESSED + 0.1
    assert [one["kind"] for one in rest] == ["summary"]


def test_a_picture_of_a_frame_is_drawn_and_nothing_written(call, tmp_path):
    path = FILES["Contactile"][0](tmp_path)
    done = call("layout", path)
    assert done.exit_code == 0
    *_, top, first, second, third, bottom = done.stdout.strip().splitlines()
    assert top == bottom == "+------+"
    assert "@@" in second
    assert "@@" not in first + third
    assert 'channels = ["x", "y", "z"]' in done.stdout
    assert "# shape: 9 taxels are taken as 3 rows of 3" in done.stdout
    assert not path.with_suffix(".toml").exists()


def test_what_the_file_does_not_say_is_asked_for(call, tmp_path):
    np.save(tmp_path / "a.npy", np.random.default_rng(0).normal(size=(50, 4, 4, 3)))
    done = call("layout", tmp_path / "a.npy", "--write")
    assert done.exit_code == 1
    assert "rate: the file has no times: give it, as in '--set rate=60'" in done.stdout
    assert not (tmp_path / "a.toml").exists()
    done = call("layout", tmp_path / "a.npy", "--set", "rate=60", "--set", "unit=N", "--write")
    assert done.exit_code == 0
    assert "unit:" not in done.stdout
    assert cnnum.load_recording(tmp_path / "a.npy").unit == "N"


WRONG = {
    "none.csv": (None, "There is no file"),
    "empty.csv": (b"", "no table of numbers"),
    "words.csv": (b"some, words\nand, more\n", "no table of numbers"),
    "noise.bin": (bytes(range(256)) * 40, "neither a table in a text file, nor what an array"),
    "flat.npy": ("flat", "no array of frames"),
    "cut.mcap": (b"\x89MCAP0\r\n", "no MCAP file, or has no whole message"),
    "bad.jsonl": (b"{not json\n", "line 1: expected JSON"),
    "page.html": (b"<!DOCTYPE html><html></html>", "no table of numbers"),
    "pointer.npz": (b"version https://git-lfs.github.com/spec/v1\n", "a pointer of Git LFS"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_no_file_of_frames_is_one_sentence(name, call, tmp_path):
    content, said = WRONG[name]
    path = tmp_path / name
    if content == "flat":
        np.save(path, np.zeros(20))
    elif content is not None:
        path.write_bytes(content)
    done = call("layout", path)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1), done.stderr
    assert said in done.stderr
