"""The C99 of a program: no warning, clean under sanitizers, the emulator's numbers to the bit."""

import os
import re
import shutil
import subprocess

import numpy as np
import pytest

from cnnum.embedded.c.files import in_the_way
from cnnum.embedded.c.text import packed, record_type
from cnnum.embedded.emulator import cleared
from cnnum.errors import NotSupportedError
from tests.embedded.conftest import FULL, SANITIZERS, cases, compiled, made, streams, too_long

FRAMES = 50 if FULL else 20
STREAMS = max(2, int(os.environ.get("CNNUM_FRAMES", "0")) // FRAMES)
"""Streams of FRAMES frames each: `make embedded` runs 10,000 frames of every program."""

CASES = cases(("localize", "motion_direction", "on_off", "slip", "twist"), ("q15", "q7"))


def random_inputs(program, frames, batch, seed):
    """Streams of frames of the whole range of every input, and of its ends."""
    random = np.random.default_rng(seed)
    found = []
    for _ in range(frames):
        frame = {}
        for one in program.of_kind("input"):
            low, high = one.bounds
            scale = 2.0 ** -random.integers(0, one.format.bits, (batch, 1))
            whole = random.integers(low, high, (batch, one.length), endpoint=True) * scale
            ends = np.where(whole > 0, high, low)
            frame[one.name] = np.where(random.random((batch, 1)) < 0.1, ends, np.rint(whole))
            frame[one.name] = frame[one.name].astype(np.int64)
        found.append(frame)
    return found


@pytest.mark.parametrize(("program", "precision"), CASES)
def test_random_frames_give_the_same_bits(program, precision, compiler, tmp_path):
    compare(program, precision, compiler, tmp_path)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("precision", ["q3", "q23", "q8.23", "q1.30"])
@pytest.mark.parametrize("program", ["slip", "twist"])
def test_words_of_any_length_give_the_same_bits(program, precision, compiler, tmp_path):
    compare(program, precision, compiler, tmp_path)


def compare(program, precision, compiler, tmp_path):
    found = made(program, precision)
    found.export(streams((8, 8))[:2, 0]).write(tmp_path)
    main = compiled(compiler, tmp_path, program, "stream.c", *SANITIZERS)
    frames = random_inputs(found.program, FRAMES, STREAMS, 1)
    inputs, outputs = (found.program.of_kind(kind) for kind in ("input", "output"))
    answers = []
    for n in range(STREAMS):
        own = [{name: one[n : n + 1] for name, one in frame.items()} for frame in frames]
        given = b"".join(packed(inputs, frame, 1).tobytes() for frame in own)
        done = subprocess.run([main], input=given, capture_output=True, check=True)
        answers.append(np.frombuffer(done.stdout, dtype=record_type(outputs)))
    got = np.stack(answers, axis=1)
    assert got.shape == (FRAMES, STREAMS)
    state = cleared(found.program, STREAMS)
    for number, frame in enumerate(frames):
        wanted = found.emulator().run(frame, state, first=number == 0)
        for one in outputs:
            like = np.broadcast_to(wanted[one.name], got[number][one.name].shape)
            np.testing.assert_array_equal(got[number][one.name], like, one.name)


def test_a_transient_of_too_many_steps_is_refused_in_one_sentence():
    with pytest.raises(NotSupportedError, match="at most 200,000"):
        too_long()


@pytest.mark.parametrize(("name", "precision"), [("twist", "q15"), ("contact", "float32")])
def test_the_test_vector_passes(name, precision, compiler, tmp_path):
    """Without memory from a heap; whole numbers need no library, and no floats, either."""
    found = made(name, precision, method="euler")
    exported = found.export(streams((8, 8))[:, 0])
    exported.write(tmp_path)
    main = compiled(compiler, tmp_path, name, "vector.c", *SANITIZERS)
    assert subprocess.run([main], check=False).returncode == 0
    text = exported.files[f"{name}.c"]
    assert "malloc" not in text
    assert ("float" in text) == (precision == "float32")
    assert ("-lm" in exported.files["Makefile"]) == (precision == "float32")


def test_the_test_vector_fails_on_other_code(compiler, tmp_path):
    found = made("twist", "q15")
    found.export(streams((8, 8))[:, 0]).write(tmp_path)
    source = tmp_path / "twist.c"
    other = source.read_text().replace("m->started = 1", "m->started = 0")
    source.write_text(other)
    main = compiled(compiler, tmp_path, "twist", "vector.c")
    assert subprocess.run([main], check=False).returncode == 1


def test_make_says_whether_the_vector_passes(compiler, tmp_path):
    if shutil.which("make") is None:
        pytest.skip("needs make")
    made("twist", "q15").export(streams((8, 8))[:, 0]).write(tmp_path)
    assert in_the_way(tmp_path, "twist") is None
    assert in_the_way(tmp_path, "slip") == "vector.c"
    command = ["make", "-C", tmp_path, f"CC={compiler}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, "The test vector of twist passes." in done.stdout) == (0, True)
    (tmp_path / "vector").write_text("#!/bin/sh\nexit 1\n")
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "The answers differ from the test vector." in done.stderr


@pytest.mark.parametrize("name", ["slip", "twist"])
def test_sizes_are_those_of_the_compiler(name, compiler, tmp_path):
    needs = ["slip_strength", "gross_slip"] if name == "slip" else None
    exported = made(name, "q15", needs=needs).export(streams((8, 8))[:2, 0])
    exported.write(tmp_path)
    sizes = exported.memory_bytes, exported.input_bytes, exported.output_bytes
    kinds = ("memory", "input", "output")
    wrong = " || ".join(
        f"sizeof({name}_{kind}) != {size}" for kind, size in zip(kinds, sizes, strict=True)
    )
    text = f'#include "{name}.h"\nint main(void) {{ return {wrong}; }}\n'
    (tmp_path / "sizes.c").write_text(text)
    main = compiled(compiler, tmp_path, name, "sizes.c")
    assert subprocess.run([main], check=False).returncode == 0
    for kind, size in zip(("kept and worked in", "one frame", "its answers"), sizes, strict=True):
        assert f"{kind}: {size} bytes" in exported.files[f"{name}.h"], kind


def test_only_what_is_wanted_is_exported():
    both = made("twist", "q15").export(streams((8, 8))[:, 0])
    one = made("twist", "q15", needs=["twist_row"]).export(streams((8, 8))[:, 0])
    assert "shear" not in one.files["twist.h"]
    assert one.memory_bytes < both.memory_bytes
    assert one.input_bytes == both.input_bytes // 3


def test_a_vector_fails_for_a_stub_for_nan_for_a_flip_and_without_a_reset(compiler, tmp_path):
    """Of whole numbers and of floats; every output changes, and the memory is cleared midway."""
    for precision in ("q15", "float32"):
        folder = tmp_path / precision
        program = made("twist", precision)
        exported = program.export(streams((8, 8)))
        exported.write(folder)
        vector, source = exported.vector, folder / "twist.c"
        assert vector.still == ("twist_level",)  # a level is one number
        assert vector.remembers
        assert sum(vector.begins) > 1
        assert sum(vector.unseen.values()) < vector.flipped
        text, head = source.read_text(), (folder / "vector.c").read_text().split("*/")[0]
        assert f"Of {vector.flipped} constants" in " ".join(head.split())
        step = text.index("void twist_step(")
        outputs = program.program.of_kind("output")
        nan = "\n".join(
            f"    out->{one.name} = nothing / nothing;" for one in outputs if not one.logic
        )
        others = {
            "as it is": text,
            "stub": text[:step] + STUB,
            "no reset": text.replace("bytes[n] = 0;", "bytes[n] = bytes[n];"),
            "flip": flipped(text),
        }
        if precision == "float32":
            others["NaN"] = text[:step] + STUB.replace(
                "    (void)out;", f"    volatile float nothing = 0.0f;\n{nan}"
            )
        for name, other in others.items():
            source.write_text(other)
            main = compiled(compiler, folder, "twist", "vector.c", "-Wno-error")
            done = subprocess.run([main], check=False)
            assert done.returncode == int(name != "as it is"), (precision, name)


STUB = """void twist_step(twist_memory *m, const twist_input *in, twist_output *out)
{
    (void)m;
    (void)in;
    (void)out;
}
"""


def flipped(text):
    """The text with another sign of the first constant factor of a frame."""
    found = re.search(r"\* (\(?)(-?)(\d+(?:\.\d+)?f?|INT64_C\(\d+\))(?=[^\]]*;\n)", text)
    assert found is not None
    at = found.start(3)
    return f"{text[:at]}-{text[at:]}" if not found[2] else text[: at - 1] + text[at:]
