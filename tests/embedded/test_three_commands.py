"""A program of one's own, from Python to a Cortex-M4 at 1 kHz, by three commands."""

import ctypes
import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

import cnnum
from cnnum.lab.embedded.cortex_m import Board, Machine, board_text, missing_tools
from cnnum.scenes.loaded_export import _layout

pytestmark = pytest.mark.skipif(
    bool(missing_tools()) or shutil.which("make") is None, reason="no compilers"
)
COUNT = int(os.environ.get("CNNUM_FRAMES", "60"))
"""Frames: 10,000 under `make embedded`."""

PROGRAM = """import cnnum

ECHO, MEDIAN, DIFFUS = map(cnnum.get_template, ("ECHO", "MEDIAN", "DIFFUS"))


@cnnum.program
def feel(frame, *, rate: float = 200.0):
    slow = frame.memory("slow").mean(frame.normal, 1.0 / (0.05 * rate))
    late = cnnum.apply(ECHO, input=frame.normal - slow, duration=1.0)
    middle = cnnum.apply(MEDIAN, input=late, state=late, duration=0.5)
    smooth = cnnum.loop(
        lambda x: cnnum.apply(DIFFUS, state=x, duration=0.2), middle, limit=4,
        until=lambda x: x.max() < 0.1,
    )
    return {"smooth": smooth.values[0], "most": smooth.values[0].max(), "ended": smooth.finished}
"""


def pressed(count, seed):
    """A bump that moves and comes and goes, in noise, (count, 4, 4)."""
    rng, times = np.random.default_rng(seed), np.arange(count)[:, None, None] / 1000.0
    rows, cols = np.indices((4, 4))
    bump = np.exp(-((rows - 1.5) ** 2 + (cols - 1.5 - np.sin(6 * times)) ** 2) / 2.0)
    return bump * (1.0 + np.sin(20 * times)) + 0.02 * rng.normal(size=(count, 4, 4))


def test_a_program_of_ones_own_runs_on_a_chip_at_its_rate(tmp_path):
    """A loop, a memory, a delayed and a nonlinear template: bits of the M4 are those of this core,
    in frames of a press and of numbers up to twice the range, and 1 kHz fits 168 MHz."""
    (tmp_path / "own.py").write_text(PROGRAM)
    recording = cnnum.Recording(pressed(400, 0), rate=1000.0, unit="N", channels=("normal",))
    recording.save(tmp_path / "kept.npz")
    folder = tmp_path / "feel-c"
    (tmp_path / "board.c").write_text(board_text("feel"))
    core = ("-target", "thumb-freestanding-eabi", "-mcpu=cortex_m4", "-static", "-Wl,-e,board_main")
    for command in (
        ("cnnum", "export", "own.py:feel", "--like", "kept.npz", "-o", "feel-c"),
        ("make", "-C", "feel-c", "check"),
        ("ziglang", "cc", *core, "-O2", "-std=c99", "-ffp-contract=off", "-Ifeel-c", "-o",
         "feel.elf", "board.c", "feel-c/feel.c"),
    ):  # fmt: skip
        python = () if command[0] == "make" else (sys.executable, "-P", "-m")
        subprocess.run((*python, *command), cwd=tmp_path, check=True, capture_output=True)

    loaded = cnnum.load_export(folder)
    (part,) = json.loads((folder / "export.json").read_text())["inputs"]
    pressing = np.ldexp(pressed(COUNT, 1), part["fraction"])
    noise = np.random.default_rng(2).integers(2 * part["least"], 2 * part["largest"], (COUNT, 4, 4))
    whole = np.where((np.arange(COUNT) // 20 % 2 == 0)[:, None, None], pressing, noise)
    whole = np.clip(np.rint(whole), part["least"], part["largest"])
    given = np.zeros(COUNT, dtype=_layout(loaded.inputs))
    given[part["member"]] = whole
    wanted = np.zeros(COUNT, dtype=_layout(loaded.outputs))
    words = np.zeros(loaded.library.cnnum_size(0) // 8 + 1, dtype=np.int64)
    memory, first, last = (a.ctypes.data_as(ctypes.c_void_p) for a in (words, given, wanted))
    loaded.library.cnnum_run(memory, ctypes.c_int32(1), first, last, ctypes.c_int64(COUNT))

    machine = Machine(Board(None, "m4", (tmp_path / "feel.elf").read_bytes()))
    machine.call("board_reset", counts=False)
    worst = 0
    for n in range(COUNT):
        machine.write("board_input", given[n : n + 1].tobytes())
        worst = max(worst, machine.call("board_step", counts=n % 1000 == 30))
        answer = machine.read("board_output", wanted.dtype.itemsize)
        assert answer == wanted[n : n + 1].tobytes(), n
    assert len(np.unique(wanted)) > 0.9 * COUNT
    assert 0 < worst < 168_000
