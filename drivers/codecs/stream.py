"""Scans, and their extraction from a stream of bytes that may be cut or corrupted anywhere.

A format looks at the bytes in front of it and gives one of three answers: a scan of some length;
bytes to skip; more bytes are needed. The rest is the same for all formats.

Scans of protocols without a check, held against those before and after them.

Nothing in such a packet shows that a number was damaged on the way. But a load goes on from scan to
scan, and damage does not: a scan that jumps away from the one before it, where the one after it
goes back, is refused. Only a scan that jumps waits for the next one; all others count at once.
"""

import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.errors import CodecError
from cnnum.frame import Limits, limits_of

U16, U32, U64 = 1 << 16, 1 << 32, 1 << 64


def numbers_or_none(values: Floats) -> bool:
    """Return whether most taxels have numbers in all channels, and no number is infinite.

    A lost chip of an array sends NaN in all channels, or in all but its temperature. Other packets
    with numbers that are not finite do not come from the array.
    """
    if np.isfinite(values).all():
        return True
    lost = np.isnan(values).any(axis=2)
    return not np.isinf(values).any() and 2 * int(lost.sum()) < lost.size


def within(values: Floats, limits: Limits | None) -> bool:
    """Return whether all numbers, (…, channels), are within limits."""
    if limits is None:
        return True
    low, high = limits_of(limits, values.shape[-1])
    return not ((values < low) | (values > high)).any()


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One scan as its device sent it.

    Attributes
    ----------
    values : (rows, cols, channels) array
    channels : tuple of str
        Names of the last axis.
    unit : str
    sequence : int or None
        The device's own count of its scans, modulo `sequence_wrap`; None if it does not count.
    time_us : int or None
        Time on the device's clock, µs, modulo `time_wrap`; None if it has no clock.
    period_us : int
        Time from scan to scan, µs; 0 if the device does not report it.
    saturated : bool
        Whether a cell is at an end of its range.
    at_end : (rows, cols) bool, optional
        Cells at an end of their range, if known.
    arrived_ns : int, optional
        Arrival on the host's monotonic clock, for a scan that has been held back.
    extras : mapping of str to float
        Further values that the device reports, by names that begin with "device_".
    """

    values: NDArray[np.generic]
    channels: tuple[str, ...]
    unit: str
    sequence: int | None = None
    time_us: int | None = None
    sequence_wrap: int = U32
    time_wrap: int = U64
    period_us: int = 0
    saturated: bool = False
    at_end: NDArray[np.bool_] | None = None
    arrived_ns: int | None = None
    extras: Mapping[str, float] = field(default_factory=dict[str, float])

    def __post_init__(self) -> None:
        if self.values.ndim != 3 or self.values.shape[2] != len(self.channels):
            raise CodecError(
                f"A scan of the channels {self.channels} must have the shape "
                f"(rows, cols, {len(self.channels)}), got {self.values.shape}."
            )

    @property
    def kind(self) -> str:
        """Description of the array that the scan comes from."""
        rows, cols, _ = self.values.shape
        return f"{rows}×{cols} taxels of {', '.join(self.channels)} in {self.unit}"


PART = 16
"""A step below this part of a strong load is never a jump: an error of that size does little."""

TIMES = 4.0
"""Size of a jump relative to the usual step; the noise of any array stays below it."""

LAST, ENOUGH = 33, 9
"""Steps whose median is the usual one, and those before which nothing is a jump."""


class Neighbours:
    """Passes on scans that are consistent with their neighbours, with a delay of at most one.

    Scans are compared by the largest step of each channel, and by the steps of the device's clock
    and count if it has them. The usual step is a median, so neither vibration that lasts longer
    than half of `LAST` scans nor a number that always changes counts as damage.

    Parameters
    ----------
    full : float
        Change of a taxel's number under a strong load.
    """

    def __init__(self, full: float) -> None:
        self._full = full
        self._steps = deque[Floats](maxlen=LAST)
        self._last: Scan | None = None
        self._seen: Scan | None = None
        self._held: Scan | None = None

    def take(self, scan: Scan) -> tuple[list[Scan], int]:
        """Return the scans that now count as good, and the number that are now rejected."""
        last, seen, self._seen = self._last, self._seen, scan
        if last is None or seen is None or _kind(last) != _kind(scan):
            refused = self.lost()
            self._steps.clear()
            self._last = scan
            return [scan], refused
        # those of refused ones, too: what goes on for long is no damage
        self._steps.append(_step(seen, scan))
        if len(self._steps) < ENOUGH:
            self._last = scan
            return [scan], 0
        passed, refused = list[Scan](), 0
        held, self._held = self._held, None
        if held is not None:
            apart = self._apart(held, scan)
            if apart <= 1.0 or apart < self._apart(last, scan):
                passed.append(held)
                last = held
            else:
                refused = 1
        if self._apart(last, scan) <= 1.0:
            passed.append(scan)
            last = scan
        else:
            self._held = replace(scan, arrived_ns=time.monotonic_ns())
        self._last = last
        return passed, refused

    def lost(self) -> int:
        """Return the number of scans that wait for one that never came; they are rejected."""
        held, self._held = self._held, None
        return int(held is not None)

    def agree(self, scan: Scan) -> bool:
        """Return whether a scan continues the last one, as far as that can be judged."""
        last = self._last
        if last is None or _kind(last) != _kind(scan) or len(self._steps) < ENOUGH:
            return False
        largest = float(self._limits()[2:].max())
        return largest < self._full and self._apart(last, scan) <= 1.0

    def _limits(self) -> Floats:
        usual = TIMES * np.median(np.array(self._steps), axis=0)
        usual[2:] = np.maximum(usual[2:], self._full / PART)
        return usual

    def _apart(self, scan: Scan, other: Scan) -> float:
        """Return the largest step between two scans, where 1 is the largest that is no jump."""
        limits = self._limits()
        known = limits > 0.0  # a clock or a count that stands still says nothing
        return float((_step(scan, other)[known] / limits[known]).max())


def _kind(scan: Scan) -> tuple[object, ...]:
    return scan.values.shape, scan.channels, scan.unit


def _step(scan: Scan, other: Scan) -> Floats:
    """Return how far time, count and each channel go from a scan to another."""
    before, after = (np.asarray(reading.values, np.float64) for reading in (scan, other))
    moved = np.nan_to_num(np.abs(after - before)).max(axis=(0, 1))  # NaN of a lost taxel
    time_us = _ahead(scan.time_us, other.time_us, other.time_wrap)
    count = _ahead(scan.sequence, other.sequence, other.sequence_wrap)
    return np.array([time_us, count, *moved.tolist()])


def _ahead(later: int | None, earlier: int | None, wrap: int) -> float:
    if later is None or earlier is None:
        return 0.0
    return float(abs((earlier - later + wrap // 2) % wrap - wrap // 2))


MOST_WAITING = 1 << 21
"""Bytes that may wait for the end of their scan."""


@dataclass(frozen=True, slots=True)
class Found:
    """A good packet of `size` bytes at the beginning of the data.

    Attributes
    ----------
    size : int
    scan : Scan or None
        The scan that it completes.
    alone : bool
        Whether only the packet itself shows that it is one. It is then good only if its scan
        continues the previous one.
    """

    size: int
    scan: Scan | None = None
    alone: bool = False


@dataclass(frozen=True, slots=True)
class Skip:
    """Bytes at the beginning that belong to no good packet.

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
    """Splits a stream into scans, and counts the losses.

    Parameters
    ----------
    format : Format
    neighbours : Neighbours, optional
        For a protocol without a check, they decide whether a scan counts as good.

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
    """Return whether a packet gives way to one that begins inside it.

    This is for checks so short that random bytes can pass them. Among overlapping candidates, the
    one that is followed by more packets is accepted, and the first one in a tie.

    Parameters
    ----------
    data : bytearray
    size : int
        Bytes of a packet.
    marker : bytes
        Bytes with which each packet begins.
    whole : callable
        Whether the bytes of a packet pass its check.
    ended : bool

    Returns
    -------
    Found or Skip or None
        The packet is accepted; it is rejected; more bytes are needed.
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
    """Return the offsets in [begin, end) at which a marker begins."""
    result: list[int] = []
    at = data.find(marker, begin)
    while 0 <= at < end:
        result.append(at)
        at = data.find(marker, at + 1)
    return result
