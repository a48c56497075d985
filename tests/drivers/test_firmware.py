"""The reference firmware in C: the decoder reads the packets that it sends."""

import shutil
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest

from cnnum.drivers.codecs.wire import wire
from cnnum.lab.embedded.cortex_m import FLAGS, LINKED, Board, Machine, missing_tools

ROOM = Path(__file__).parents[2] / "docs" / "firmware"
COMPILER = shutil.which("gcc") or shutil.which("cc")


@pytest.fixture(scope="module", params=[(), ("-DCNNUM_CRC_TABLES",)], ids=["bits", "tables"])
def firmware(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    if COMPILER is None:
        pytest.skip("no C compiler is here")
    made = tmp_path_factory.mktemp("firmware") / "sketch"
    files = [ROOM / "sketch.c", ROOM / "cnnum_packet.c"]
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic"]
    flags += request.param
    done = subprocess.run([COMPILER, *flags, *files, "-o", made], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return made


@pytest.mark.parametrize("shape", [(2, 2), (3, 5), (8, 8)])
def test_what_the_firmware_sends_is_read(firmware: Path, shape: tuple[int, int]) -> None:
    rows, cols = shape
    command = [firmware, str(rows), str(cols), "20", "250"]
    data = subprocess.run(command, capture_output=True, check=True).stdout
    decoder = wire("open").decoder()
    scans = decoder.feed(data)
    assert (len(scans), decoder.bad, decoder.discarded) == (20, 0, 0)
    row, col, side = np.indices((rows, cols, 4))
    for number, scan in enumerate(scans):
        np.testing.assert_array_equal(scan.values, 2048 + 64 * row + 8 * col + side + number % 16)
        assert (scan.sequence, scan.time_us, scan.period_us) == (number, 250 * number, 250)
        assert (scan.channels, scan.unit) == (("left", "right", "top", "bottom"), "count")


def test_the_firmware_refuses_another_size(firmware: Path) -> None:
    assert subprocess.run([firmware, "9", "8"], check=False).returncode == 2


SEALS = """#include "cnnum_packet.h"
void *memset(void *to, int value, size_t count);
void *memset(void *to, int value, size_t count)
{
    volatile uint8_t *byte = to;
    while (count--) *byte++ = (uint8_t)value;
    return to;
}
static const struct cnnum_array array = {8, 8, 3, CNNUM_I16, CNNUM_FORCE, CNNUM_COUNT, 1000};
uint8_t packet[420];
__attribute__((noinline)) void seal(void);
void seal(void) { cnnum_packet_seal(packet, &array, 7, 7000, 0); }
void board_main(void);
void board_main(void) { seal(); }
"""


@pytest.mark.skipif(bool(missing_tools()), reason="no emulated core")
def test_tables_seal_the_same_packet_on_a_core(tmp_path: Path) -> None:
    """8×8×3 cells of 16 bits on an M4; Zig's compiler has tables of its own for loops over bits."""
    counts, packets = [], []
    (tmp_path / "seals.c").write_text(SEALS)
    for tables in ((), ("-DCNNUM_CRC_TABLES",)):
        source = [tmp_path / "seals.c", ROOM / "cnnum_packet.c", f"-I{ROOM}"]
        target = ["-target", "thumb-freestanding-eabi", "-mcpu=cortex_m4"]
        zig = [sys.executable, "-P", "-m", "ziglang", "cc", *target, *FLAGS, *LINKED, *tables]
        subprocess.run([*zig, "-o", "seal.elf", *source], cwd=tmp_path, check=True)
        machine = Machine(Board(None, "m4", (tmp_path / "seal.elf").read_bytes()))
        counts.append(machine.call("seal"))
        packets.append(machine.read("packet", 420))
    assert packets[0] == packets[1]
    assert zlib.crc32(packets[0][:416]) == int.from_bytes(packets[0][416:], "little")
    assert 4_000 < counts[1] < 6_000  # 5,235 by GCC, which takes 20,641 without tables
