"""An export that is compiled and run here: the emulator's bits on frames of one's own."""

import json
import shutil
import subprocess
import sys
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np
import pytest

import cnnum
from cnnum import kernels as ir
from cnnum.embedded.c.text import packed, record_type
from cnnum.embedded.emulator import Emulator, cleared
from cnnum.embedded.formats import precision_named
from cnnum.embedded.making import make, quantised
from cnnum.errors import ArrayError, NotSupportedError, ProgramError, UnknownNameError
from cnnum.graph.schedule import schedule
from tests.embedded.conftest import FULL, STRICT

needs_cc = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
ZIG = (sys.executable, "-P", "-m", "ziglang", "cc")

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


APART = """#include "mixed.h"
#include <stdio.h>
static mixed_kept kept;
static mixed_scratch scratch;
static mixed_input input;
static mixed_output output;
int main(void)
{
    uint32_t state = 1u;
    mixed_reset_kept(&kept);
    while (fread(&input, sizeof input, 1, stdin) == 1) {
        for (uint32_t n = 0; n < (uint32_t)sizeof scratch; ++n) {
            state = state * 1664525u + 1013904223u;
            ((uint8_t *)&scratch)[n] = (uint8_t)(state >> 24);
        }
        mixed_step_in(&kept, &scratch, &input, &output);
        fwrite(&output, sizeof output, 1, stdout);
        fwrite(&kept.saturated, 4, 1, stdout);
    }
    return 0;
}
"""


@dataclass(slots=True, eq=False)
class Limits(Emulator):
    """Counts the numbers that a limit changes."""

    changed: int = 0

    def value(self, expression):
        result = Emulator.value(self, expression)
        if isinstance(expression, ir.Call) and expression.function == "limit":
            before, count = self.changed, Emulator.value(self, expression.arguments[0])
            self.changed = before + int((count != result).sum())
        return result


@needs_cc
@pytest.mark.parametrize("share_memory", [False, True])
def test_scratch_may_hold_anything_and_saturations_are_counted(tmp_path, share_memory):
    """Sections for code and tables too: the linker is given both."""
    given = cnnum.Recording(frames(), rate=100.0, unit="N", channels=("a", "unread", "b"))
    export = cnnum.export(mixed, like=given, share_memory=share_memory)
    export.write(tmp_path)
    (tmp_path / "apart.c").write_text(APART)
    places = [f'-DCNNUM_{what}_SECTION=__attribute__((section(".my_{what}")))' for what in
              ("CODE", "CONST")]  # fmt: skip
    command = ["cc", *STRICT, "-fsanitize=undefined,address", "-DCNNUM_COUNT_SATURATIONS", *places,
               "-o", "apart", "apart.c", "mixed.c"]  # fmt: skip
    subprocess.run(command, cwd=tmp_path, check=True)
    assert b".my_CODE" in (tmp_path / "apart").read_bytes()
    program, numbers = export.program, 3.0 * frames(60, seed=5)
    inputs, outputs = (program.of_kind(kind) for kind in ("input", "output"))
    given = [
        {one.name: quantised(one, numbers[n, ..., "a_b".index(one.name[-1])].reshape(1, -1))
         for one in inputs}
        for n in range(60)
    ]  # fmt: skip
    text = b"".join(packed(inputs, frame, 1).tobytes() for frame in given)
    said = subprocess.run(["./apart"], cwd=tmp_path, input=text, capture_output=True, check=True)
    answers = np.frombuffer(said.stdout, [("out", record_type(outputs)), ("saturated", "<u4")])
    state, emulator = cleared(program, 1), Limits(program)
    for n, (frame, answer) in enumerate(zip(given, answers, strict=True)):
        wanted = emulator.run(frame, state, first=n == 0)
        for one in outputs:
            np.testing.assert_array_equal(answer["out"][one.name], wanted[one.name][0], one.name)
        assert answer["saturated"] == emulator.changed
    assert emulator.changed > 10


def swapped(command, folder, **more):
    """Run a program for a big-endian core."""
    return subprocess.run(["qemu-mips-static", *command], cwd=folder, check=True, **more)


@pytest.mark.skipif(
    not FULL or find_spec("ziglang") is None or shutil.which("qemu-mips-static") is None,
    reason="make embedded, with Zig and qemu-mips-static",
)
def test_streams_are_the_same_on_a_big_endian_core(tmp_path):
    """The test vector passes there, and answers in little-endian are those of this core."""
    export = exported(tmp_path)
    for name in ("vector", "stream"):
        command = [*ZIG, "-target", "mips-linux-musleabi", *STRICT, "-static", "-O1", "-o"]
        subprocess.run([*command, name, f"{name}.c", "mixed.c"], cwd=tmp_path, check=True)
    swapped(["./vector"], tmp_path)
    inputs, rng = export.program.of_kind("input"), np.random.default_rng(1)
    given = np.zeros(50, dtype=record_type(inputs))
    for one in inputs:
        given[one.name] = rng.integers(*one.bounds, given[one.name].shape)
    there = swapped(["./stream"], tmp_path, input=given.tobytes(), capture_output=True).stdout
    subprocess.run(["make", "-B", "stream"], cwd=tmp_path, check=True, capture_output=True)
    here = subprocess.run(["./stream"], cwd=tmp_path, input=given.tobytes(), capture_output=True)
    assert there == here.stdout
    size = record_type(export.program.of_kind("output")).itemsize
    assert len({there[at : at + size] for at in range(0, len(there), size)}) > 40
