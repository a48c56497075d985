"""The C of a program on emulated Cortex cores: the same bits, and a count of instructions."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import correlate

import cnnum
from cnnum.embedded.formats import precision_named
from cnnum.embedded.making import make
from cnnum.errors import UnknownNameError
from cnnum.graph.schedule import schedule
from cnnum.lab.embedded.cortex_m import Board, missing_tools
from tests.embedded.conftest import made, streams

pytestmark = pytest.mark.skipif(
    bool(missing_tools()), reason=f"not installed: {', '.join(missing_tools())}"
)
FRAMES = streams((8, 8), 30)[:, 0]


@pytest.fixture(scope="module")
def twist():
    return made("twist", "q15")


@pytest.mark.parametrize("core", ["m0", "m4"])
def test_answers_are_the_same_to_the_bit(core, twist):
    board = Board.built(twist, FRAMES[:2], core)
    counted = board.run(FRAMES[::10])
    assert counted.wrong == 0
    assert len(counted.instructions) == 3
    # measured: 22 thousand on an M4, which multiplies to 64 bits, 80 thousand on an M0
    assert 10_000 < counted.worst < 150_000
    memory = twist.export(FRAMES[:1]).memory_bytes
    assert memory < counted.ram_bytes < memory + 4096
    assert counted.frames_per_second(168e6) == 168e6 / counted.worst


def kernels(rows, cols):
    """Weights without any symmetry."""
    return np.random.default_rng(rows).uniform(-1.0, 1.0, (rows, cols))


@cnnum.program
def sums(frame):
    wide = cnnum.Template("wide", A=np.zeros((3, 3)), B=kernels(9, 9), z=0.25)
    near = cnnum.Template("near", A=np.zeros((3, 3)), B=kernels(3, 3), z=-0.5)
    return {
        "wide": cnnum.apply(wide, input=frame.normal, duration=1.0),
        "near": cnnum.apply(near, input=frame.normal, duration=1.0),
    }


def test_products_by_two_give_the_same_bits_in_fewer_instructions():
    """Of a template wider than its map, and of one of 3×3, up to the ends of 16 bits."""
    frames = np.random.default_rng(0).uniform(-0.25, 0.25, (6, 5, 6, 1))
    frames[::2] = np.sign(frames[::2]) * 0.25
    planned = schedule(sums.trace((5, 6), ("normal",)), ("normal",), None)
    export = make("sums", planned, precision_named("q15"), frames[:, np.newaxis])
    for name, size, z in (("wide", 9, 0.25), ("near", 3, -0.5)):
        weighted = [correlate(u[..., 0], kernels(size, size), mode="constant") for u in frames]
        exact = np.clip((1.0 - np.exp(-1.0)) * (np.array(weighted) + z), -1.0, 1.0)
        ours = export.run(frames[:, np.newaxis])[name][:, 0]
        # weights, inputs and answers have 16 bits: each of 81 terms is off by a part in 2^16
        np.testing.assert_allclose(ours, exact, rtol=0.0, atol=size * size * 0.25 * 2.0**-15)
    by_two, singly = (
        Board.built(export, frames[:1], "m4", flags).run(frames * 3.0)
        for flags in ((), ("-DCNNUM_PAIRS=0",))
    )
    assert by_two.wrong == singly.wrong == 0
    assert by_two.worst < singly.worst


def test_a_wrong_answer_is_seen(twist):
    board = Board.built(twist, FRAMES[:2], "m4")
    # an emulator that never writes the answers
    broken = replace(twist.program, body=twist.program.body[:4])
    board.made = replace(twist, program=broken)
    assert board.run(FRAMES[:12]).wrong > 0


def test_a_core_by_another_name_is_refused(twist):
    with pytest.raises(UnknownNameError, match="'m4'"):
        Board.built(twist, FRAMES[:1], "cortex-a9")
