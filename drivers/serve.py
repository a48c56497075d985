"""Play the device: write frames as an array's firmware would, to a file descriptor."""

import os
import time
from collections.abc import Callable, Iterable, Iterator

from cnnum.drivers.codecs.stream import Scan
from cnnum.drivers.codecs.wire import encode_scan
from cnnum.frame import Frame, Quality


def scan_of(frame: Frame, rate: float) -> Scan:
    """Return the scan that a device would have sent for a frame.

    Parameters
    ----------
    frame : Frame
    rate : float
        Hz, sent to the other side as the period.
    """
    return Scan(
        values=frame.values,
        channels=frame.channels,
        unit=frame.unit,
        sequence=frame.sequence,
        time_us=round(frame.time * 1e6),
        period_us=round(1e6 / rate),
        saturated=bool(frame.quality & Quality.SATURATED),
    )


def packets(frames: Iterable[Frame], rate: float, cell: str = "<f4") -> Iterator[bytes]:
    """Yield each frame's bytes in the open protocol.

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
        yield encode_scan(scan_of(frame, rate), cell)


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
    data = packets(frames, rate, cell)
    return pace(data, rate, lambda scan: write_all(fd, scan)) if paced else _at_once(data, fd)


def pace(parts: Iterable[bytes], rate: float, write: Callable[[bytes], object]) -> int:
    """Write parts at a rate by the clock, and return how many; a late one is not waited for."""
    begin, count = time.monotonic(), 0
    for data in parts:
        time.sleep(max(0.0, begin + count / rate - time.monotonic()))
        write(data)
        count += 1
    return count


def _at_once(parts: Iterable[bytes], fd: int) -> int:
    count = 0
    for data in parts:
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
