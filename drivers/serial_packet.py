"""The open serial protocol (``docs/serial-protocol.md``): a scan as a packet, and a stream.

Pure: bytes to packets and back.

Packets out of a stream of bytes that may be cut or corrupted anywhere.

Bytes are given up one by one, never a whole packet at once: when a check fails, the search for the
next marker goes on one byte after the failed packet's own marker. So a good packet that begins
inside the failed one is still found.
"""

import binascii
import struct
import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.errors import CodecError
from cnnum.frame import FORCE_AXES

MARKER = b"\xc3NUM"
"""First four bytes of every packet."""

VERSION = 1
"""Version of the layout below."""

HEADER = struct.Struct("<4sBBBBBBBBIQIHH")
"""marker, version, rows, cols, channels, cell type, layout, unit, flags, sequence, time (µs),
period (µs), reserved, CRC-16 of the 30 bytes before it."""

TAIL = struct.Struct("<I")
"""CRC-32 of everything before it."""

MAX_PAYLOAD = 1 << 20
"""Bytes; a header that promises more is not believed."""

SATURATED = 1
"""Bit of the flags byte: a cell stands at an end of its range."""

CELL_TYPES = {1: "<u1", 2: "<i1", 3: "<u2", 4: "<i2", 5: "<i4", 6: "<f4"}
"""Code of a cell's type to its numpy name."""

BRIDGES = ("left", "right", "top", "bottom")
"""The four half bridges of a taxel, in the order of the last axis."""

LAYOUTS: dict[int, tuple[str, ...]] = {1: ("normal",), 2: FORCE_AXES, 3: BRIDGES}
"""Code of a channel layout to the channels' names; 0 leaves them unnamed."""

UNITS = {0: "count", 1: "V", 2: "N", 3: "Pa", 4: "strain"}
"""Code of the unit to its name."""

SEQUENCE_WRAP = 1 << 32
"""The sequence number counts modulo this."""


def crc16(data: bytes) -> int:
    """Return the CRC-16/IBM-3740 ("CCITT-FALSE"): polynomial 0x1021, start 0xFFFF, not reflected.

    Its check value, of the nine digits ``123456789``, is 0x29B1.
    """
    return binascii.crc_hqx(data, 0xFFFF)


def crc32(data: bytes) -> int:
    """Return the CRC-32/ISO-HDLC of Ethernet and zip: polynomial 0x04C11DB7, start and final
    exclusive-or 0xFFFFFFFF, reflected.

    Its check value, of the nine digits ``123456789``, is 0xCBF43926.
    """
    return zlib.crc32(data)


@dataclass(frozen=True, slots=True)
class Geometry:
    """The constants of an array's packets.

    Attributes
    ----------
    rows, cols, channels : int
        1 to 255 each.
    cell, layout, unit : int
        Codes: `CELL_TYPES`, `LAYOUTS` (or 0), `UNITS`.
    """

    rows: int
    cols: int
    channels: int
    cell: int = 6
    layout: int = 0
    unit: int = 0

    def __post_init__(self) -> None:
        sides = (self.rows, self.cols, self.channels)
        if not all(1 <= n <= 255 for n in sides):
            raise CodecError(f"A packet has 1 to 255 rows, columns and channels, got {sides}.")
        for name, code, table in (
            ("cell type", self.cell, CELL_TYPES),
            ("unit", self.unit, UNITS),
            ("channel layout", self.layout, {0: (), **LAYOUTS}),
        ):
            if code not in table:
                raise CodecError(f"A packet's {name} must be one of {sorted(table)}, got {code}.")
        if self.layout and len(LAYOUTS[self.layout]) != self.channels:
            raise CodecError(
                f"The channel layout {self.layout} has {len(LAYOUTS[self.layout])} channels, "
                f"got {self.channels}."
            )
        if self.payload > MAX_PAYLOAD:
            raise CodecError(f"A payload is at most {MAX_PAYLOAD} bytes, got {self.payload}.")

    @property
    def dtype(self) -> np.dtype[np.generic]:
        """Type of a cell, little-endian."""
        return np.dtype(CELL_TYPES[self.cell])

    @property
    def payload(self) -> int:
        """Bytes of the cells."""
        return self.rows * self.cols * self.channels * self.dtype.itemsize

    @property
    def packet(self) -> int:
        """Bytes of a whole packet."""
        return HEADER.size + self.payload + TAIL.size

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels."""
        return LAYOUTS.get(self.layout) or tuple(f"channel_{i}" for i in range(self.channels))


@dataclass(frozen=True, slots=True, eq=False)
class Packet:
    """One scan on the wire.

    Attributes
    ----------
    geometry : Geometry
    values : (rows, cols, channels) array of the geometry's cell type
    sequence : int
        Number of the scan, modulo 2³².
    time_us : int
        µs on the device's clock, modulo 2⁶⁴.
    period_us : int
        µs from scan to scan as the device is set; 0 where it does not say.
    flags : int
        Bit 0 (`SATURATED`); the others are 0.
    """

    geometry: Geometry
    values: NDArray[np.generic]
    sequence: int
    time_us: int
    period_us: int = 0
    flags: int = 0


@dataclass(frozen=True, slots=True)
class Header:
    """A packet's header, whose own CRC was right."""

    geometry: Geometry
    sequence: int
    time_us: int
    period_us: int
    flags: int


def encode(packet: Packet) -> bytes:
    """Return the bytes of a packet.

    Raises
    ------
    CodecError
        If the values do not fit the geometry's shape or cell type, or a number is out of range.
    """
    g = packet.geometry
    fields = (g.rows, g.cols, g.channels, g.cell, g.layout, g.unit, packet.flags)
    numbers = (packet.sequence, packet.time_us, packet.period_us)
    try:
        head = HEADER.pack(MARKER, VERSION, *fields, *numbers, 0, 0)[:-2]
    except struct.error:
        raise CodecError(
            f"A packet's flags, sequence, time and period must fit u8, u32, u64 and u32, got "
            f"{(packet.flags, *numbers)}."
        ) from None
    body = head + struct.pack("<H", crc16(head)) + _payload(g, packet.values)
    return body + TAIL.pack(crc32(body))


def _payload(geometry: Geometry, values: NDArray[np.generic]) -> bytes:
    shape = (geometry.rows, geometry.cols, geometry.channels)
    if values.shape != shape or not np.can_cast(values.dtype, geometry.dtype, "equiv"):
        raise CodecError(
            f"A packet's values must be {geometry.dtype} of shape {shape}, "
            f"got {values.dtype} of shape {values.shape}."
        )
    return values.astype(geometry.dtype).tobytes()


def decode_header(data: bytes) -> Header:
    """Return the header that `data` starts with.

    Raises
    ------
    CodecError
        If it is cut, has no marker, another version, a wrong CRC-16 or unknown codes.
    """
    if len(data) < HEADER.size:
        raise CodecError(f"A header has {HEADER.size} bytes, got {len(data)}.")
    marker, version, *codes, flags, sequence, time_us, period_us, _, check = HEADER.unpack_from(
        data
    )
    if marker != MARKER:
        raise CodecError(f"A packet starts with {MARKER.hex(' ')}, got {marker.hex(' ')}.")
    got = crc16(data[: HEADER.size - 2])
    if got != check:
        raise CodecError(f"The header's CRC-16 must be {got:#06x}, got {check:#06x}.")
    if version != VERSION:
        raise CodecError(
            f"The packet has version {version}, expected {VERSION}: a newer cnnum may read it."
        )
    return Header(Geometry(*codes), sequence, time_us, period_us, flags)


def decode(data: bytes) -> Packet:
    """Return the packet that `data` holds, no more and no less.

    Raises
    ------
    CodecError
        If the header is wrong, the length is not the one that it promises, or the CRC-32 fails.
    """
    header = decode_header(data)
    geometry = header.geometry
    if len(data) != geometry.packet:
        raise CodecError(f"The packet must have {geometry.packet} bytes, got {len(data)}.")
    (check,) = TAIL.unpack_from(data, geometry.packet - TAIL.size)
    got = crc32(data[: -TAIL.size])
    if got != check:
        raise CodecError(f"The packet's CRC-32 must be {got:#010x}, got {check:#010x}.")
    cells = np.frombuffer(data[HEADER.size : -TAIL.size], dtype=geometry.dtype)
    values = cells.reshape(geometry.rows, geometry.cols, geometry.channels)
    return Packet(geometry, values, header.sequence, header.time_us, header.period_us, header.flags)


class StreamDecoder:
    """Cut a stream into packets and count the lost ones.

    Parameters
    ----------
    geometry : Geometry, optional
        The array's; else the first good packet's is taken. A header with another one is not
        believed. So no chance hit among lost bytes can promise a length of its own.

    Attributes
    ----------
    geometry : Geometry or None
    stranger : Geometry or None
        That of another array: it stood in two good headers, and no good packet came between them.
    good, bad : int
        Packets that passed, and those with a good header whose CRC-32 failed.
    discarded : int
        Bytes that belonged to no good packet.
    resyncs : int
        Times in which bytes had to be discarded before a packet was found again.
    """

    def __init__(self, geometry: Geometry | None = None) -> None:
        self.geometry = geometry
        self.stranger: Geometry | None = None
        self._suspect: Geometry | None = None
        self.good = self.bad = self.discarded = self.resyncs = 0
        self._buffer = bytearray()
        self._lost = False

    @property
    def pending(self) -> int:
        """Bytes that wait for the rest of their packet."""
        return len(self._buffer)

    def feed(self, chunk: bytes) -> list[Packet]:
        """Return the packets that `chunk` completes, in order."""
        self._buffer += chunk
        return self._drain(ended=False)

    def flush(self) -> list[Packet]:
        """Return the whole packets in the waiting bytes: the stream has ended or broken."""
        return self._drain(ended=True)

    def _drain(self, *, ended: bool) -> list[Packet]:
        packets: list[Packet] = []
        while self._seek(ended=ended):
            size = self._size()
            if size is None:
                self._discard(1)
            elif len(self._buffer) >= size:
                self._take(size, packets)
            elif ended:
                self._discard(1)
            else:
                break
        return packets

    def _seek(self, *, ended: bool) -> bool:
        """Bring a marker to the front; False if there is none, or its header is not whole yet."""
        at = self._buffer.find(MARKER)
        if at < 0:
            kept = 0 if ended else self._marker_beginning()
            self._discard(len(self._buffer) - kept)
            return False
        self._discard(at)
        if len(self._buffer) < HEADER.size and ended:
            self._discard(1)
            return self._seek(ended=True)
        return len(self._buffer) >= HEADER.size

    def _marker_beginning(self) -> int:
        """Length of the longest beginning of a marker that the bytes end with."""
        lengths = range(min(len(MARKER) - 1, len(self._buffer)), 0, -1)
        return next((n for n in lengths if self._buffer.endswith(MARKER[:n])), 0)

    def _size(self) -> int | None:
        """Bytes of the packet at the front, or None if its header cannot be believed."""
        try:
            header: Header = decode_header(bytes(self._buffer[: HEADER.size]))
        except CodecError:
            return None
        if self.geometry is not None and header.geometry != self.geometry:
            if header.geometry == self._suspect:  # one alone may be chance
                self.stranger = header.geometry
            self._suspect = header.geometry
            return None
        return header.geometry.packet

    def _take(self, size: int, packets: list[Packet]) -> None:
        try:
            packet = decode(bytes(self._buffer[:size]))
        except CodecError:
            self.bad += 1
            self._discard(1)
            return
        del self._buffer[:size]
        self.geometry, self._suspect = packet.geometry, None
        self.good += 1
        self._lost = False
        packets.append(packet)

    def _discard(self, count: int) -> None:
        if count <= 0:
            return
        del self._buffer[:count]
        self.discarded += count
        if not self._lost:
            self._lost = True
            self.resyncs += 1
