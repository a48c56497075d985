"""Cycles of instructions: sequences whose cycles were counted by hand in Arm's tables."""

import subprocess
import sys
from dataclasses import replace
from math import inf

import pytest

from cnnum.lab.embedded.cortex_m import CORES, LINKED, Board, Machine, missing_tools
from cnnum.lab.embedded.costs import fit_sentence, fits
from cnnum.lab.embedded.cycles import cycles_of
from tests.embedded.test_costs import ROW

pytestmark = pytest.mark.skipif(
    bool(missing_tools()), reason=f"not installed: {', '.join(missing_tools())}"
)

# text, by core (least, most) cycles of all, and words of code and of data on an M4. Each ends with
# `bx lr`: a branch, 2 to 4 cycles on an M4 and 3 on an M0
SEQUENCES = {
    "nothing": ("", {"m4": (2, 4), "m0": (3, 3)}, 1),
    "sums": ("adds r0, r0, r1\n subs r0, #1\n lsls r0, r0, #2\n", {"m4": (5, 7), "m0": (6, 6)}, 4),
    "product": ("muls r0, r1, r0\n", {"m4": (3, 5), "m0": (4, 35)}, 2),
    "load": ("mov r2, sp\n ldr r0, [r2]\n str r0, [r2]\n", {"m4": (5, 9), "m0": (8, 8)}, 6),
    # 1 + 3 to push three, 1 + 3 to pop them; an M4 may save the first cycle of each
    "stack": ("push {r4, r5, r6}\n pop {r4, r5, r6}\n", {"m4": (8, 12), "m0": (11, 11)}, 9),
    # four rounds of a subtraction and a branch that is taken three times
    "loop": ("movs r0, #4\n1: subs r0, #1\n bne 1b\n", {"m4": (11, 25), "m0": (12, 20)}, 10),
    "long": ("umull r2, r3, r0, r1\n udiv r2, r0, r1\n", {"m4": (5, 17)}, 3),
    "wide": ("ldrd r2, r3, [sp]\n strh.w r2, [sp]\n add.w r0, r1, r2\n", {"m4": (6, 10)}, 7),
    "call": ("mov r2, lr\n bl 2f\n mov lr, r2\n b 3f\n2: bx lr\n3:\n", {"m4": (10, 18)}, 6),
}  # fmt: skip
TEXT = ".syntax unified\n.thumb\n.text\n.global board_main\n.type board_main, %function\n"


@pytest.fixture(scope="module", params=["m4", "m0"])
def machine(request, tmp_path_factory):
    core, place = request.param, tmp_path_factory.mktemp("cycles")
    text = TEXT + "board_main: bx lr\n"
    for name, (body, wanted, _) in SEQUENCES.items():
        if core in wanted:
            text += f".global {name}\n.type {name}, %function\n{name}:\n {body} bx lr\n"
    (place / "all.s").write_text(text)
    zig = [sys.executable, "-P", "-m", "ziglang", "cc", "-target", "thumb-freestanding-eabi"]
    flags = [f"-mcpu={CORES[core]}", "-Wl,-e,board_main", *LINKED[2:], "-g0"]
    subprocess.run([*zig, *flags, "-o", "all.elf", "all.s"], cwd=place, check=True)
    return core, Machine(Board(None, core, (place / "all.elf").read_bytes()))


@pytest.mark.parametrize("name", SEQUENCES)
def test_intervals_are_those_of_the_manual(machine, name):
    core, board = machine
    _, wanted, words = SEQUENCES[name]
    if core not in wanted:
        pytest.skip("the core has no such instruction")
    board.call(name)
    least, most = cycles_of(core, board.executed, board.fetch)
    assert (least, most) == wanted[core]
    if core == "m4":
        assert cycles_of(core, board.executed, board.fetch, 5)[1] == most + 5 * words
    assert cycles_of("m7", board.executed, board.fetch) == (board.executed.total() / 2, inf)


def test_the_answer_is_yes_no_or_unsure():
    row = replace(ROW, cycles_least=80_000.0, cycles_most=200_000.0, clock_hz=168e6)
    assert [fits(row, rate) for rate in (840.0, 841.0, 2100.0, 2101.0)] == [
        "yes", "unsure", "unsure", "no",
    ]  # fmt: skip
    sentence = fit_sentence(row, 1000.0, power=0.2)
    assert "unsure (80,000 to 200,000 cycles, 47.6 to 119 % of a frame, 16 to 40 µJ" in sentence
    assert "to more" in fit_sentence(replace(row, cycles_most=inf), 1000.0)
