"""Packets out of a stream of bytes that may be cut or corrupted anywhere.

Bytes are given up one by one, never a whole packet at once: when a check fails, the search for the
next marker goes on one byte after the failed packet's own marker. So a good packet that begins
inside the failed one is still found.
"""

from cnnum.drivers.serial_packet import (
    HEADER,
    MARKER,
    Geometry,
    Header,
    Packet,
    decode,
    decode_header,
)
from cnnum.errors import CodecError


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
