"""An export that is compiled and run here: the emulator's bits on frames of one's own."""

import json
import shutil

import numpy as np
import pytest

import cnnum
from cnnum.embedded.formats import precision_named
from cnnum.embedded.making import make
from cnnum.errors import ArrayError, NotSupportedError, ProgramError, UnknownNameError
from cnnum.graph.schedule import schedule

needs_cc = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")

SHAPE = (3, 4)
EDGE = cnnum.Template("edge", [[2.0]], [[0, -1, 0], [-1, 4, -1], [0, -1, 0]], -0.5)


@cnnum.program
def mixed(frame, *, rate: float = 200.0):
    """A memory, a flag, a template by steps, and a channel that is not read."""
    past = frame.memory("past")
    share = float(np.exp(-1.0 / (0.05 * rate)))
    now = share * past.value + (1.0 - share) * frame.b
    past.store(now)
    return {
        "late": now,
        "most": now.max(),
        "down": now < 0.0,
        "edge": cnnum.apply(EDGE, input=frame.a, duration=2.0),
    }


def frames(count=40, seed=0):
    return np.random.default_rng(seed).uniform(-8.0, 8.0, (count, *SHAPE, 3))


def exported(folder, precision="q15"):
    given = cnnum.Recording(frames(), rate=100.0, unit="N", channels=("a", "unread", "b"))
    found = cnnum.export(mixed, precision=precision, like=given)
    found.write(folder)
    return found


@needs_cc
@pytest.mark.parametrize("precision", ["q15", "q7", "q31"])
def test_the_bits_are_those_of_the_emulator(tmp_path, precision):
    """On frames beyond the range of its inputs too."""
    channels = ("a", "unread", "b")
    planned = schedule(mixed.trace(SHAPE, channels), channels, None)
    found = make("mixed", planned, precision_named(precision), frames()[:, None])
    found.export(frames()[:2]).write(tmp_path)
    loaded = cnnum.load_export(tmp_path)
    shown = 3.0 * frames(200, seed=5)
    wanted, given = found.run(shown[:, None]), loaded.run(shown)
    assert given.keys() == wanted.keys()
    for name, values in given.items():
        assert np.ptp(values) > 0
        np.testing.assert_array_equal(values, wanted[name][:, 0], name)


@needs_cc
def test_recordings_streams_and_arrays_agree(tmp_path):
    exported(tmp_path)
    loaded = cnnum.load_export(tmp_path)
    assert (loaded.shape, loaded.channels, loaded.rate, loaded.unit) == (
        SHAPE, ("a", "unread", "b"), 100.0, "N",
    )  # fmt: skip
    shown = frames(seed=1)
    recording = cnnum.Recording(
        shown[..., [2, 0, 1]], rate=100.4, unit="N", channels=("b", "a", "unread")
    )
    whole, stream = loaded.run(recording), loaded.stream()
    pushed = [stream.push(frame) for frame in shown]
    for name, values in whole.items():
        np.testing.assert_array_equal(values, np.stack([one[name] for one in pushed]))
    # the program by its formula: sixteen bits of a range up to 16, and a memory of roundings
    share, late = float(np.exp(-1.0 / (0.05 * 100.0))), np.zeros(SHAPE)
    for frame, given in zip(shown, whole["late"], strict=True):
        late = share * late + (1.0 - share) * frame[..., 2]
        np.testing.assert_allclose(given, late, atol=2.0**-10)
    assert stream.limited == 0
    stream.push(100.0 * shown[0])
    assert stream.limited > SHAPE[0] * SHAPE[1]


@needs_cc
def test_what_does_not_fit_is_one_sentence(tmp_path, monkeypatch):
    exported(tmp_path)
    loaded = cnnum.load_export(tmp_path)
    slow = cnnum.Recording(frames(), rate=50.0, channels=("a", "unread", "b"))
    with pytest.raises(ArrayError, match=r"50 frames per second.*for 100"):
        loaded.run(slow)
    with pytest.raises(UnknownNameError, match="channel 'unread'"):
        loaded.run(cnnum.Recording(frames()[..., :2], rate=100.0, channels=("a", "b")))
    with pytest.raises(ArrayError, match="takes frames"):
        loaded.run(frames()[:, :2])
    with pytest.raises(ArrayError, match="finite"):
        loaded.run(np.full((1, *SHAPE, 3), np.nan))
    with pytest.raises(ProgramError, match=r"'cnnum export' of this version"):
        cnnum.load_export(tmp_path / "none")
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(NotSupportedError, match="set CC"):
        cnnum.load_export(tmp_path)
    monkeypatch.delenv("CC")
    with monkeypatch.context() as without:
        without.setattr(shutil, "which", lambda name: None)
        with pytest.raises(NotSupportedError, match="no C compiler was found"):
            cnnum.load_export(tmp_path)
    record = json.loads((tmp_path / "export.json").read_text())
    record["inputs"][0]["type"] = "int32_t"
    (tmp_path / "export.json").write_text(json.dumps(record))
    with pytest.raises(ProgramError, match="structures in its header"):
        cnnum.load_export(tmp_path)
    (tmp_path / "mixed.c").write_text("int x = ;\n")
    with pytest.raises(ProgramError, match="cannot be compiled"):
        cnnum.load_export(tmp_path)


@needs_cc
def test_what_is_no_number_or_no_record_is_one_sentence(tmp_path, monkeypatch):
    exported(tmp_path, "float32")
    loaded = cnnum.load_export(tmp_path)
    with pytest.raises(ArrayError, match="more than float32 holds"):
        loaded.run(np.full((1, *SHAPE, 3), 1e39))
    for wrong in ([[1.0], [1.0, 2.0]], "abc", None, frames() + 1j):
        with pytest.raises(ArrayError, match="'frames' must be"):
            loaded.run(wrong)
        with pytest.raises(ArrayError, match="'frame' must be"):
            loaded.stream().push(wrong)
    monkeypatch.setenv("CC", "'cc")
    with pytest.raises(NotSupportedError, match="a quotation is open"):
        cnnum.load_export(tmp_path)
    monkeypatch.setenv("CC", "  ")
    assert cnnum.load_export(tmp_path).shape == SHAPE
    path = tmp_path / "export.json"
    text = path.read_text()
    for wrong in ("[]", "{}", "null", text.replace('"float"', '"double"'), text.replace("3,", "")):
        path.write_text(wrong)
        with pytest.raises(ProgramError, match="is not the record of an export"):
            cnnum.load_export(tmp_path)


def test_pictures_need_no_recording():
    """Programs of pictures were offered by name, and refused."""
    found = cnnum.export("life", (5, 6))
    assert "in_picture, -1 white to 1 black" in " ".join(found.files["life.h"].split())
    assert found.vector.still == ("still",)
