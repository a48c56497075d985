"""Scans out of a stream of bytes that may be cut or corrupted anywhere, in any format.

A format looks at the bytes in front of it and gives one of three answers: a scan of some length;
bytes to skip; more bytes are needed. The rest is the same for all formats.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from cnnum.drivers.codecs.neighbours import Neighbours
from cnnum.drivers.codecs.scan import Scan

MOST_WAITING = 1 << 21
"""Bytes that may wait for the end of their scan."""


@dataclass(frozen=True, slots=True)
class Found:
    """A good packet of `size` bytes at the front.

    Attributes
    ----------
    size : int
    scan : Scan or None
        The one that it completes.
    alone : bool
        Whether nothing but the packet itself says that it is one: then it is good only where its
        scan goes on from the one before.
    """

    size: int
    scan: Scan | None = None
    alone: bool = False


@dataclass(frozen=True, slots=True)
class Skip:
    """Bytes at the front that belong to no good packet.

    Attributes
    ----------
    size : int
    bad : bool
        Whether they began a packet whose check failed.
    """

    size: int
    bad: bool = False


DEPTH = 2
"""Packets in a row that are compared where two beginnings overlap."""

MORE = None
"""The bytes at the front are not whole yet."""


class Format(Protocol):
    """Recognises the packets of one kind of array."""

    def look(self, data: bytearray, *, locked: bool, ended: bool) -> Found | Skip | None:
        """Return the scan, gap or wait at the front of `data`.

        Parameters
        ----------
        data : bytearray
            At least one byte; it must not be changed.
        locked : bool
            Whether a good packet ended where `data` begins.
        ended : bool
            Whether no more bytes come.
        """
        ...


class Decoder:
    """Cuts a stream into scans and counts the losses on the way.

    Parameters
    ----------
    format : Format
    neighbours : Neighbours, optional
        Of a protocol without a check: they decide whether a scan counts as good.

    Attributes
    ----------
    good, bad : int
        Packets that passed their check or their neighbours, and those that did not.
    discarded : int
        Bytes that belonged to no good packet.
    resyncs : int
        Times in which bytes had to be discarded before a packet was found again.
    conflict : str
        Sentence on another array that answers, or an empty string if none does.
    """

    def __init__(self, format: Format, neighbours: Neighbours | None = None) -> None:
        self._format, self._neighbours = format, neighbours
        self.good = self.bad = self.discarded = self.resyncs = 0
        self.conflict = ""
        self._buffer = bytearray()
        self._locked = self._lost = False

    @property
    def pending(self) -> int:
        """Bytes that wait for the rest of their packet."""
        return len(self._buffer)

    @property
    def trouble(self) -> str:
        """Why the last whole packet gave no scan, where its format says so."""
        return str(getattr(self._format, "trouble", ""))

    def feed(self, chunk: bytes) -> list[Scan]:
        """Return the scans that `chunk` completes, in their order."""
        self._buffer += chunk
        return self._drain(ended=False)

    def flush(self, *, lost: bool = True) -> list[Scan]:
        """Return the whole scans in the waiting bytes: the stream has ended or broken.

        Parameters
        ----------
        lost : bool
            Whether no scan follows soon. If one does, only the answer to a request has ended.
        """
        scans = self._drain(ended=True)
        self._locked = False
        if lost and self._neighbours is not None:
            self.bad += self._neighbours.lost()
        return scans

    def _drain(self, *, ended: bool) -> list[Scan]:
        scans: list[Scan] = []
        while self._buffer:
            seen = self._format.look(self._buffer, locked=self._locked, ended=ended)
            if isinstance(seen, Found) and seen.alone and not self._agree(seen.scan):
                seen = Skip(1, bad=self._locked)
            if isinstance(seen, Found):
                self._take(seen, scans)
            elif isinstance(seen, Skip):
                self.bad += seen.bad
                self._discard(seen.size)
            elif ended or len(self._buffer) > MOST_WAITING:
                self._discard(1)
            else:
                break
        return scans

    def _agree(self, scan: Scan | None) -> bool:
        return scan is not None and self._neighbours is not None and self._neighbours.agree(scan)

    def _take(self, found: Found, scans: list[Scan]) -> None:
        del self._buffer[: found.size]
        self._locked, self._lost = True, False
        if found.scan is None or self._neighbours is None:
            self.good += 1
            scans += [] if found.scan is None else [found.scan]
            return
        passed, refused = self._neighbours.take(found.scan)
        self.good, self.bad = self.good + len(passed), self.bad + refused
        scans += passed

    def _discard(self, count: int) -> None:
        size = min(count, len(self._buffer))
        del self._buffer[:size]
        self.discarded += size
        self._locked = False
        if not self._lost:
            self._lost = True
            self.resyncs += 1


def to_marker(data: bytearray, marker: bytes, *, ended: bool) -> Skip | None:
    """Return the bytes before the first marker, or those that cannot begin one.

    None is returned where the marker is in front, or may be.
    """
    at = data.find(marker)
    if at == 0:
        return None
    if at > 0:
        return Skip(at)
    lengths = range(min(len(marker) - 1, len(data)), 0, -1)
    kept = 0 if ended else next((n for n in lengths if data.endswith(marker[:n])), 0)
    return Skip(len(data) - kept) if len(data) > kept else None


def overtaken(
    data: bytearray, size: int, marker: bytes, whole: Callable[[bytes], bool], *, ended: bool
) -> Found | Skip | None:
    """Return whether a packet at the front gives way to one that begins inside of it.

    For checks so short that chance passes them: of beginnings that overlap, the one that more
    packets follow is believed, and the first of equal ones.

    Parameters
    ----------
    data : bytearray
    size : int
        Bytes of a packet.
    marker : bytes
        That each packet begins with.
    whole : callable
        Whether the bytes of a packet pass its check.
    ended : bool

    Returns
    -------
    Found or Skip or None
        The packet stands; it does not; more bytes are needed.
    """

    def chain(start: int) -> int:
        for count in range(DEPTH):
            at = start + count * size
            packet = bytes(data[at : at + size])
            if len(packet) < size or not packet.startswith(marker) or not whole(packet):
                return count
        return DEPTH

    # a header of which only the first bytes are here may be that of a rival, too
    partial = range(max(1, len(data) - len(marker) + 1), size)
    if not ended and any(marker.startswith(data[at:]) for at in partial):
        return MORE
    rivals = places(data, marker, 1, size)
    if not rivals:
        return Found(size)
    if len(data) < (1 + DEPTH) * size and not ended:
        return MORE
    stands = max(map(chain, rivals)) <= chain(0)
    return Found(size) if stands else Skip(1, bad=True)


def places(data: bytearray, marker: bytes, begin: int, end: int) -> list[int]:
    """Return the places from `begin` on, before `end`, at which a marker begins."""
    found: list[int] = []
    at = data.find(marker, begin)
    while 0 <= at < end:
        found.append(at)
        at = data.find(marker, at + 1)
    return found
