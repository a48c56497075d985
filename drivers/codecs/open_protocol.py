"""The open protocol (``docs/serial-protocol.md``) as one protocol among others."""

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.drivers.codecs.scan import Scan
from cnnum.drivers.codecs.wire import Asked, Wire
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
from cnnum.drivers.serial_stream import StreamDecoder
from cnnum.errors import CodecError


def open_protocol(asked: Asked) -> Wire:
    """Return the open protocol; its packets say all there is to say of the array."""
    return Wire("the open protocol", 921_600, OpenDecoder, encode_scan)


def scan_of(packet: Packet) -> Scan:
    """Return a packet's scan."""
    return Scan(
        values=packet.values,
        channels=packet.geometry.names,
        unit=UNITS[packet.geometry.unit],
        sequence=packet.sequence,
        sequence_wrap=SEQUENCE_WRAP,
        time_us=packet.time_us,
        period_us=packet.period_us,
        saturated=bool(packet.flags & SATURATED),
    )


class OpenDecoder:
    """Scans of the open protocol; its counts are those of `StreamDecoder`."""

    def __init__(self) -> None:
        self._stream = StreamDecoder()

    @property
    def good(self) -> int:
        """Packets that passed their checks."""
        return self._stream.good

    @property
    def bad(self) -> int:
        """Packets with a good header whose CRC-32 failed."""
        return self._stream.bad

    @property
    def discarded(self) -> int:
        """Bytes that belonged to no good packet."""
        return self._stream.discarded

    @property
    def resyncs(self) -> int:
        """Times in which bytes had to be discarded before a packet was found again."""
        return self._stream.resyncs

    @property
    def conflict(self) -> str:
        """Describe the other array that answers, or an empty string if none does."""
        mine, other = self._stream.geometry, self._stream.stranger
        if mine is None or other is None:
            return ""
        return f"{_in_words(other)} in place of {_in_words(mine)}"

    def feed(self, chunk: bytes) -> list[Scan]:
        """Return the scans that `chunk` completes."""
        return [scan_of(packet) for packet in self._stream.feed(chunk)]

    def flush(self, *, lost: bool = True) -> list[Scan]:
        """Return the whole scans in the waiting bytes; each is good by its checks, lost or not."""
        return [scan_of(packet) for packet in self._stream.flush()]


def _in_words(geometry: Geometry) -> str:
    names, unit = ", ".join(geometry.names), UNITS[geometry.unit]
    return f"{geometry.rows}×{geometry.cols} taxels of {names} in {unit} ({geometry.dtype})"


def geometry_of(scan: Scan, cell: str = "<f4") -> Geometry:
    """Return the geometry in which a scan is sent.

    Raises
    ------
    CodecError
        If the protocol has no code for the scan's unit or for the cell type.
    """
    units = {name: code for code, name in UNITS.items()}
    cells = {name: code for code, name in CELL_TYPES.items()}
    layouts = {names: code for code, names in LAYOUTS.items()}
    if scan.unit not in units or cell not in cells:
        raise CodecError(
            f"The protocol carries the units {', '.join(units)} in the cell types "
            f"{', '.join(cells)}, got '{scan.unit}' in '{cell}'."
        )
    rows, cols, channels = scan.values.shape
    layout = layouts.get(scan.channels, 0)
    return Geometry(rows, cols, channels, cells[cell], layout, units[scan.unit])


def encode_scan(scan: Scan, cell: str = "<f4") -> bytes:
    """Return the packet of a scan; whole cells are rounded to, and clipped at their range.

    Raises
    ------
    CodecError
        If the protocol cannot carry it.
    """
    geometry = geometry_of(scan, cell)
    packet = Packet(
        geometry=geometry,
        values=_cells(np.asarray(scan.values, np.float64), geometry.dtype),
        sequence=(scan.sequence or 0) % SEQUENCE_WRAP,
        time_us=scan.time_us or 0,
        period_us=scan.period_us,
        flags=SATURATED if scan.saturated else 0,
    )
    return encode(packet)


def _cells(values: Floats, dtype: np.dtype[np.generic]) -> NDArray[np.generic]:
    if dtype.kind == "f":
        return values.astype(dtype)
    bits = 8 * dtype.itemsize
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if dtype.kind == "i" else (0, 2**bits - 1)
    return np.clip(np.rint(values), low, high).astype(dtype)
