"""The C of a program by GCC for Arm on QEMU's cores: the same bits, and a second count."""

import subprocess

import pytest

from cnnum.embedded.formats import precision_named
from cnnum.embedded.making import make
from cnnum.errors import NotSupportedError
from cnnum.lab.embedded import gnu_arm
from cnnum.lab.embedded.cortex_m import CORES, Board, board_text, missing_tools
from cnnum.lab.embedded.gnu_arm import FLAGS, MACHINES, gnu_counted, missing_gnu_tools
from tests.embedded.conftest import made, scheduled, streams

needs_gnu = pytest.mark.skipif(
    bool(missing_gnu_tools()), reason=f"not installed: {', '.join(missing_gnu_tools())}"
)
FRAMES = streams((8, 8), 30)[::10, 0]


@pytest.fixture(scope="module")
def twist():
    return made("twist", "q15")


@needs_gnu
@pytest.mark.skipif(bool(missing_tools()), reason="needs the extra 'embedded'")
@pytest.mark.parametrize("core", ["m0", "m4"])
def test_two_emulators_count_the_same_instructions(core, twist, tmp_path):
    """GCC's code on Unicorn, which sees every instruction, against QEMU's clock."""
    found = gnu_counted(twist, FRAMES, core)
    assert found.wrong == 0
    twist.export(FRAMES[:1]).write(tmp_path)
    (tmp_path / "board.c").write_text(board_text("twist"))
    cpu = f"-mcpu={CORES[core].replace('_', '-')}"
    link = ("-Wl,-e,board_main", "-Wl,-Ttext=0x10000", "-Wl,-Tdata=0x20000000")
    helpers = "void *memset(void *p, int v, unsigned n) { volatile char *c = p; while (n--) "
    (tmp_path / "helpers.c").write_text(helpers + "*c++ = (char)v; return p; }\n")
    command = [gnu_arm.COMPILER, cpu, *FLAGS, *link, "-o", "board.elf", "board.c", "twist.c",
               "helpers.c", "-lgcc"]  # fmt: skip
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    board = Board(twist, core, (tmp_path / "board.elf").read_bytes())
    exact = board.run(FRAMES).instructions
    # two reads of the timer, each to a tick, and the call; a skipped instruction counts on QEMU
    # alone, as it takes its cycle on a core
    for other, one in zip(found.instructions, exact, strict=True):
        assert one - 2 * MACHINES[core][1] <= other <= 1.15 * one + 2 * MACHINES[core][1]


@needs_gnu
def test_an_answer_of_another_program_is_seen(twist, monkeypatch):
    real = gnu_arm._vectors

    def wrong(*given):
        inputs, outputs = real(*given)
        return inputs, [bytes(byte ^ 1 for byte in one) for one in outputs]

    monkeypatch.setattr(gnu_arm, "_vectors", wrong)
    assert gnu_counted(twist, FRAMES, "m4").wrong == len(FRAMES)


def test_reals_are_refused():
    reals = make("twist", scheduled("twist"), precision_named("float32"), FRAMES[:, None])
    with pytest.raises(NotSupportedError, match="whole numbers"):
        gnu_counted(reals, FRAMES, "m4")


def test_a_machine_without_the_tools_names_them(monkeypatch):
    monkeypatch.setattr(gnu_arm.shutil, "which", lambda name: None)
    assert missing_gnu_tools() == ("arm-none-eabi-gcc", "arm-none-eabi-size", "qemu-system-arm")
