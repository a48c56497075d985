"""Play the device: write frames as packets to a file descriptor, as an array's firmware would."""

import os
import time
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.drivers.serial_packet import (
    CELL_TYPES,
    LAYOUTS,
    SATURATED,
    SEQUENCE_WRAP,
    UNITS,
    Geometry,
    Packet,
    encode,
)
from cnnum.errors import CodecError
from cnnum.frame import Frame, Quality


def geometry_of(frame: Frame, cell: str = "<f4") -> Geometry:
    """Return the geometry in which a frame is sent.

    Raises
    ------
    CodecError
        If the protocol has no code for the frame's unit or for the cell type.
    """
    units = {name: code for code, name in UNITS.items()}
    cells = {name: code for code, name in CELL_TYPES.items()}
    layouts = {names: code for code, names in LAYOUTS.items()}
    if frame.unit not in units or cell not in cells:
        raise CodecError(
            f"The protocol carries the units {', '.join(units)} in the cell types "
            f"{', '.join(cells)}, got '{frame.unit}' in '{cell}'."
        )
    layout = layouts.get(frame.channels, 0)
    rows, cols = frame.shape
    return Geometry(rows, cols, len(frame.channels), cells[cell], layout, units[frame.unit])


def packets(frames: Iterable[Frame], rate: float, cell: str = "<f4") -> Iterator[bytes]:
    """Yield each frame's bytes.

    Parameters
    ----------
    frames : iterable of Frame
    rate : float
        Hz, sent to the other side as the period.
    cell : str
        One of the protocol's cell types; whole ones are rounded to, and clipped at their range.

    Raises
    ------
    CodecError
        If the protocol cannot carry the frames.
    """
    for frame in frames:
        geometry = geometry_of(frame, cell)
        packet = Packet(
            geometry=geometry,
            values=_cells(frame.values, geometry.dtype),
            sequence=frame.sequence % SEQUENCE_WRAP,
            time_us=round(frame.time * 1e6),
            period_us=round(1e6 / rate),
            flags=SATURATED if frame.quality & Quality.SATURATED else 0,
        )
        yield encode(packet)


def _cells(values: Floats, dtype: np.dtype[np.generic]) -> NDArray[np.generic]:
    if dtype.kind == "f":
        return values.astype(dtype)
    bits = 8 * dtype.itemsize
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if dtype.kind == "i" else (0, 2**bits - 1)
    return np.clip(np.rint(values), low, high).astype(dtype)


def serve(
    frames: Iterable[Frame], fd: int, rate: float, *, cell: str = "<f4", paced: bool = True
) -> int:
    """Write frames to an open descriptor (a pseudo-terminal's, a port's) and return how many.

    Parameters
    ----------
    frames : iterable of Frame
    fd : int
        Open for writing; it stays open.
    rate : float
        Hz: scans a second.
    cell : str
        The protocol's cell type.
    paced : bool
        Keep to the rate by the clock; else write as fast as the other side reads.

    Raises
    ------
    CodecError
        If the protocol cannot carry the frames.
    OSError
        If the other side has gone.
    """
    begin = time.monotonic()
    count = 0
    for data in packets(frames, rate, cell):
        if paced:
            time.sleep(max(0.0, begin + count / rate - time.monotonic()))
        write_all(fd, data)
        count += 1
    return count


def write_all(fd: int, data: bytes) -> None:
    """Write all bytes, also where the system takes a part at a time.

    Raises
    ------
    OSError
        If the other side has gone.
    """
    view = memoryview(data)
    while view:
        view = view[os.write(fd, view) :]
