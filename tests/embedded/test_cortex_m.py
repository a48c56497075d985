"""The C of a program on emulated Cortex cores: the same bits, and a count of instructions."""

from dataclasses import replace

import pytest

from cnnum.errors import UnknownNameError
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


def test_a_wrong_answer_is_seen(twist):
    board = Board.built(twist, FRAMES[:2], "m4")
    # an emulator that never writes the answers
    broken = replace(twist.program, body=twist.program.body[:4])
    board.made = replace(twist, program=broken)
    assert board.run(FRAMES[:12]).wrong > 0


def test_a_core_by_another_name_is_refused(twist):
    with pytest.raises(UnknownNameError, match="'m4'"):
        Board.built(twist, FRAMES[:1], "cortex-a9")
