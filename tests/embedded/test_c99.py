"""The C99 of a program: no warning, clean under sanitizers, the emulator's numbers to the bit."""

import subprocess

import numpy as np
import pytest

from cnnum.embedded.c.expressions import element_type
from cnnum.embedded.c.program import WIDTHS
from cnnum.embedded.emulator import cleared
from tests.embedded.conftest import SANITIZERS, compiled, made, streams

PROGRAMS = ("slip", "twist")


def random_inputs(program, frames, seed):
    """Frames of the whole range of every input, and of its ends."""
    random = np.random.default_rng(seed)
    found = []
    for _ in range(frames):
        frame = {}
        for one in program.of_kind("input"):
            low, high = one.bounds
            scale = 2.0 ** -random.integers(0, one.format.bits)
            whole = random.integers(low, high, (1, one.length), endpoint=True) * scale
            frame[one.name] = np.rint(whole).astype(np.int64)
        found.append(frame)
    return found


def packed(arrays, values):
    """Bytes of a structure, its widest members first, as the header declares it."""
    ordered = sorted(arrays, key=lambda one: -WIDTHS[element_type(one)])
    fields = [
        (
            one.name,
            element_type(one).removesuffix("_t").replace("float", "float32"),
            max(1, one.length),
        )
        for one in ordered
    ]
    record = np.zeros((), dtype=np.dtype(fields, align=True))
    if values is not None:
        for one in ordered:
            record[one.name] = values[one.name].reshape(-1)
    return record


@pytest.mark.parametrize("precision", ["q15", "q7"])
@pytest.mark.parametrize("program", PROGRAMS)
def test_random_frames_give_the_same_bits(program, precision, compiler, tmp_path):
    found = made(program, precision)
    found.export(streams((8, 8))[:, 0]).write(tmp_path)
    main = compiled(compiler, tmp_path, program, "stream.c", *SANITIZERS)
    frames = random_inputs(found.program, 50, 1)
    inputs, outputs = (found.program.of_kind(kind) for kind in ("input", "output"))
    given = b"".join(packed(inputs, frame).tobytes() for frame in frames)
    answer = subprocess.run([main], input=given, capture_output=True, check=True).stdout
    state, like = cleared(found.program, 1), packed(outputs, None)
    got = np.frombuffer(answer, dtype=like.dtype)
    assert len(got) == len(frames)
    for number, frame in enumerate(frames):
        wanted = found.emulator().run(frame, state, first=number == 0)
        for one in outputs:
            assert got[number][one.name].tolist() == wanted[one.name].ravel().tolist()


@pytest.mark.parametrize("precision", ["q15", "float32"])
def test_the_test_vector_passes(precision, compiler, tmp_path):
    found = made("slip", precision, method="euler")
    found.export(streams((8, 8))[:, 0]).write(tmp_path)
    main = compiled(compiler, tmp_path, "slip", "vector.c", *SANITIZERS)
    assert subprocess.run([main], check=False).returncode == 0


def test_the_test_vector_fails_on_other_code(compiler, tmp_path):
    found = made("twist", "q15")
    found.export(streams((8, 8))[:, 0]).write(tmp_path)
    source = tmp_path / "twist.c"
    other = source.read_text().replace("m->started = 1", "m->started = 0")
    source.write_text(other)
    main = compiled(compiler, tmp_path, "twist", "vector.c")
    assert subprocess.run([main], check=False).returncode == 1


def test_no_memory_is_allocated_and_no_library_is_needed():
    files = made("slip", "q15").export(streams((8, 8))[:, 0]).files
    assert "malloc" not in files["slip.c"]
    assert "float" not in files["slip.c"]
    assert "-lm" not in files["Makefile"]


def test_only_what_is_wanted_is_exported():
    both = made("twist", "q15").export(streams((8, 8))[:, 0])
    one = made("twist", "q15", needs=["twist_row"]).export(streams((8, 8))[:, 0])
    assert "shear" not in one.files["twist.h"]
    assert one.memory_bytes < both.memory_bytes
    assert one.input_bytes == both.input_bytes // 3
