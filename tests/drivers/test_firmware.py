"""The reference firmware in C: the decoder reads the packets that it sends."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from cnnum.drivers.codecs.wire import wire

ROOM = Path(__file__).parents[2] / "docs" / "firmware"
COMPILER = shutil.which("gcc") or shutil.which("cc")


@pytest.fixture(scope="module")
def firmware(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if COMPILER is None:
        pytest.skip("no C compiler is here")
    made = tmp_path_factory.mktemp("firmware") / "sketch"
    files = [ROOM / "sketch.c", ROOM / "cnnum_packet.c"]
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic"]
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
