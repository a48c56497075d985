"""Reading a recording chunk by chunk, as far as it is intact."""

import math
import os
import re
import warnings
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from cnnum.errors import CodecError, RecordingError, RecordingWarning, unreadable
from cnnum.frame import Frame, Quality
from cnnum.recordings.layout import Held, Layout, attached
from cnnum.recordings.mcap_chunks import Decoder, frames_of, is_raw, raw_of
from cnnum.recordings.mcap_records import (
    LARGEST,
    MAGIC,
    PREFIX,
    RECORD,
    Budget,
    SpentError,
    WholeChunk,
    index_end,
    read_chunk,
    read_prefix,
    summary_holds,
)
from cnnum.safety.reading import open_regular

_SMALL = frozenset(Opcode) - {Opcode.CHUNK}
_CONTENT = frozenset((Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE))
_ENDS = frozenset((Opcode.DATA_END, Opcode.FOOTER, Opcode.CHUNK_INDEX, Opcode.STATISTICS))

WINDOW, FIRST_WINDOW = 1 << 20, 1 << 14
"""Bytes that are searched at a time, and at first: the next chunk may be near."""

_BEGIN = re.compile(rb"\x06(?=...[\x00-\x04]\x00\x00\x00\x00)", re.DOTALL)
"""Start of a chunk of plausible length: its opcode, and eight bytes of length."""


@dataclass(frozen=True, slots=True)
class Hole:
    """Bytes `start` to `end` of a file, which are not an intact record."""

    start: int
    end: int


@dataclass(frozen=True, slots=True)
class End:
    """The end of a file; `indexed` where a whole index stands there."""

    indexed: bool


def scan(
    file: IO[bytes], size: int, budget: Budget | None = None
) -> Iterator[WholeChunk | Hole | End]:
    """Yield the intact chunks of a file and the holes between them in order, then the end.

    Only a chunk has a checksum, so only a chunk is believed: where the bytes after one lead to no
    other, the search begins anew at the end of that chunk. A file whose messages stand in no chunk
    is believed as far as its records lead from one to the next; some of them come as one chunk.

    Parameters
    ----------
    file : binary file
    size : int
        Bytes of it that are looked at.
    budget : Budget, optional
        Budget of the work.

    Raises
    ------
    SpentError
        If the budget is spent.
    """
    budget = budget or Budget(size, math.inf)
    place = yield from _loose(file, size, budget)
    while True:
        stopped, indexed = _follow(file, place, size, budget)
        if indexed:
            yield End(indexed=True)
            return
        chunk = read_chunk(file, stopped, size, budget) or _search(file, place, size, budget)
        if chunk is None:
            if stopped < size:
                yield Hole(stopped, size)
            yield End(indexed=False)
            return
        hole = Hole(stopped if stopped <= chunk.start else place, chunk.start)
        if hole.start < hole.end:
            yield hole
        yield chunk
        place = chunk.end


def _loose(file: IO[bytes], size: int, budget: Budget) -> Generator[WholeChunk, None, int]:
    """Yield the messages before the first chunk, and return where they end; 0 if there are none."""
    file.seek(0)
    if file.read(len(MAGIC)) != MAGIC:
        return 0
    place = begin = len(MAGIC)
    end, held, channels, result = place, list[bytes](), set[bytes](), False
    while prefix := read_prefix(file, place, size):
        opcode, end = prefix
        budget.look(RECORD)
        if opcode not in _SMALL or opcode in _ENDS or end - place > LARGEST:
            break
        if opcode in _CONTENT:
            file.seek(place)
            record = file.read(end - place)
            budget.look(len(record))
            if opcode == Opcode.CHANNEL:
                channels.add(record[PREFIX.size : PREFIX.size + 2])
            elif opcode == Opcode.MESSAGE:
                if record[PREFIX.size : PREFIX.size + 2] not in channels:
                    break
                result = True
            held.append(record)
        place = end
        if result and (place - begin >= WINDOW):
            yield WholeChunk(begin, place, "", place - begin, b"".join(held))
            begin, held = place, []
    if result and held:
        yield WholeChunk(begin, place, "", place - begin, b"".join(held))
    return place if result else 0


def _follow(file: IO[bytes], place: int, size: int, budget: Budget) -> tuple[int, bool]:
    """Return where the small records from `place` on end, and whether a whole index is there."""
    if place == 0:
        file.seek(0)
        if file.read(len(MAGIC)) != MAGIC:
            return 0, False
        place = len(MAGIC)
    data_end = None
    while prefix := read_prefix(file, place, size):
        opcode, end = prefix
        budget.look(RECORD)
        if opcode not in _SMALL:
            break
        if opcode == Opcode.MESSAGE_INDEX and index_end(file, place, size) is None:
            break
        if opcode == Opcode.FOOTER:
            whole = data_end is not None and summary_holds(file, data_end, place, size)
            return place, whole
        data_end = end if opcode == Opcode.DATA_END else data_end
        place = end
    return place, False


def _search(file: IO[bytes], place: int, size: int, budget: Budget) -> WholeChunk | None:
    """Return the first whole chunk that begins at `place` or later."""
    overlap, wanted = 8, FIRST_WINDOW  # bytes that the pattern looks ahead
    while place < size:
        file.seek(place)
        window, wanted = file.read(min(wanted, size - place)), WINDOW
        budget.look(len(window))
        for match in _BEGIN.finditer(window):
            chunk = read_chunk(file, place + match.start(), size, budget)
            if chunk is not None:
                return chunk
        if place + len(window) >= size:
            return None
        place += len(window) - overlap
    return None


SORTED_AT_ONCE = 4096
"""Frames that are handed on together where all of them were sorted."""


@dataclass(frozen=True, slots=True)
class Contents:
    """The readable part of a recording.

    Attributes
    ----------
    path : Path
    size : int
        Bytes of the file when it was looked at; later bytes are not read.
    layout : Layout
    frames : int
    gaps, missing : int
        Gaps in the scan numbers, and the scans missing in them.
    holes : int
        Regions of bytes that are not an intact record.
    unreadable, tail : int
        Bytes of all these places, and of the one at the end.
    indexed : bool
        Whether a whole index stands at the end.
    ordered : bool
        Whether the frames stand in the order in which they came; if not, they are sorted in memory.
    held : tuple of Held
        Files that travel in it.
    budget : float
        How many times as much time, bytes and frames as usual reading it may take.
    """

    path: Path
    size: int
    layout: Layout
    frames: int
    gaps: int
    missing: int
    holes: int
    unreadable: int
    tail: int
    indexed: bool
    ordered: bool = True
    held: tuple[Held, ...] = ()
    budget: float = 1.0

    @property
    def whole(self) -> bool:
        """Whether all of the file is as it was written."""
        return self.indexed and not self.unreadable

    def chunks(self) -> Iterator[NDArray[np.void]]:
        """Yield the frames of one chunk after the other, as rows of `Layout.message`.

        The first after a hole has the flag `Quality.DROPPED_BEFORE` where scans are missing. A
        frame that is in the file more than once has the flag `Quality.REPEATED` from then on.

        Raises
        ------
        RecordingError
            If the file can no longer be read.
        CodecError
            If a chunk is whole, and no frames of this recording.
        """
        last: NDArray[np.void] | None = None
        for rows in self._unmarked():
            yield (marked := _repeats_marked(rows, last))
            last = marked[-1:]

    def _unmarked(self) -> Iterator[NDArray[np.void]]:
        """Yield the frames in the order in which they came."""
        if self.ordered:
            yield from self._as_they_stand()
            return
        whole = np.concatenate(list(self._as_they_stand()))
        whole = whole[np.argsort(whole["log_time"], kind="stable")]
        for begin in range(0, len(whole), SORTED_AT_ONCE):
            yield whole[begin : begin + SORTED_AT_ONCE]

    def _as_they_stand(self) -> Iterator[NDArray[np.void]]:
        decoder, last, torn = Decoder(), None, False
        with opened(self.path) as file:
            budget = Budget(self.size, self.budget)
            for part in _scanned(file, self.size, self.path, budget):
                torn = torn or isinstance(part, Hole)
                if isinstance(part, WholeChunk):
                    rows = _decoded(decoder, part, self.path, budget)
                    if torn and last is not None and len(rows):
                        rows = _flagged(rows, last)
                    if len(rows):
                        last, torn = int(rows["sequence"][-1]), False
                        yield rows

    def stored(self) -> Iterator[tuple[Frame, int]]:
        """Yield frames, and the host's time of each in ns; errors are those of `chunks`."""
        for rows in self.chunks():
            yield from frames_of(rows, self.layout)

    def raw(self) -> Iterator[tuple[int, bytes]]:
        """Yield times, in ns by the host, and bytes as they came from the port; errors as above."""
        with opened(self.path) as file:
            budget = Budget(self.size, self.budget)
            for part in _scanned(file, self.size, self.path, budget):
                if isinstance(part, WholeChunk) and is_raw(part.records):
                    yield from raw_of(part.records)

    def warn(self) -> None:
        """Name in one sentence each the part that cannot be read, and another order, if any."""
        if not self.ordered:
            warnings.warn(
                f"The frames of '{self.path}' are not in the order of their arrival: they are "
                "sorted by their log times.",
                RecordingWarning,
                stacklevel=2,
            )
        if self.whole:
            return
        first = (
            f"'{self.path}' has no complete index: {self.tail} bytes at its end are not readable"
        )
        if self.unreadable > self.tail:
            inside = self.unreadable - self.tail
            places = self.holes - bool(self.tail)
            first += f", nor are {inside} bytes in {places} places before"
        if self.indexed:
            first = f"'{self.path}' is damaged: {self.unreadable} bytes in it are not readable"
        warnings.warn(
            f"{first}; {self.frames} frames are readable, and 'cnnum recover' writes them to a "
            "complete file.",
            RecordingWarning,
            stacklevel=2,
        )


def opened(path: Path) -> IO[bytes]:
    """Return a file that is open for reading.

    Raises
    ------
    RecordingError
        If it cannot be opened, or is no regular file.
    """
    try:
        return open_regular(path)
    except OSError as error:
        raise unreadable(RecordingError, f"'{path}'", error) from None


def look(path: Path, budget: float = 1.0) -> Contents:
    """Read a recording once, and return its readable part.

    Parameters
    ----------
    path : Path
    budget : float
        How many times as much time, bytes and frames as usual reading it may take.

    Raises
    ------
    RecordingError
        If the file cannot be read.
    CodecError
        If there is no whole chunk of frames in it, or the budget is spent.
    """
    decoder, tally = Decoder(), _Tally()
    with opened(path) as file:
        size = file.seek(0, os.SEEK_END)
        spent = Budget(size, budget)
        for part in _scanned(file, size, path, spent):
            if isinstance(part, WholeChunk):
                rows = _decoded(decoder, part, path, spent)
                if rows.dtype.names and "log_time" in rows.dtype.names:
                    tally.came(rows["log_time"])
                tally.add(rows["sequence"])
            elif isinstance(part, Hole):
                tally.skip(part, size)
            else:
                tally.indexed = part.indexed
        with _of(path):
            held = tuple(item for _, _, item in attached(file, len(MAGIC), size, spent))
    if decoder.layout is None or not tally.frames:
        raise CodecError(
            f"'{path}' is not a recording of cnnum: there is no complete chunk of frames in its "
            f"{size} bytes."
        )
    return Contents(
        path=path,
        size=size,
        layout=decoder.layout,
        held=held,
        budget=budget,
        **tally.counts,
    )


class _Tally:
    """Counts frames and faults on the way through a file."""

    def __init__(self) -> None:
        self.frames = self.gaps = self.missing = 0
        self.holes = self.unreadable = self.tail = 0
        self.indexed = False
        self.ordered = True
        self._last: int | None = None
        self._came = 0

    @property
    def counts(self) -> dict[str, Any]:
        """All counts, by their names in `Contents`."""
        return {name: count for name, count in vars(self).items() if name[0] != "_"}

    def came(self, log_times: NDArray[np.uint64]) -> None:
        """Record when the frames of a chunk came."""
        if len(log_times):
            self.ordered = self.ordered and not (
                int(log_times[0]) < self._came or (log_times[1:] < log_times[:-1]).any()
            )
            self._came = int(log_times[-1])

    def add(self, sequence: NDArray[np.int64]) -> None:
        """Count the frames of a chunk, and the jumps of their numbers."""
        if not len(sequence):
            return
        before = [] if self._last is None else [self._last]
        steps = np.diff(np.concatenate([np.array(before, np.int64), sequence]))
        self.frames += len(sequence)
        self.gaps += int(((steps < 0) | (steps > 1)).sum())
        self.missing += int((steps[steps > 1] - 1).sum())
        self._last = int(sequence[-1])

    def skip(self, hole: Hole, size: int) -> None:
        """Count a hole."""
        self.holes += 1
        self.unreadable += hole.end - hole.start
        self.tail = hole.end - hole.start if hole.end == size else 0


def _scanned(
    file: IO[bytes], size: int, path: Path, budget: Budget
) -> Iterator[WholeChunk | Hole | End]:
    try:
        with _of(path):
            yield from scan(file, size, budget)
    except OSError as error:
        raise unreadable(RecordingError, f"'{path}'", error) from None


@contextmanager
def _of(path: Path) -> Generator[None, None, None]:
    """Say of which file a budget is spent, and which option raises it."""
    try:
        yield
    except SpentError as error:
        raise CodecError(
            f"'{path}' is refused: {error}. If you trust it, raise 'budget' above 1, as in "
            "'--set array.budget=10' of 'cnnum replay' or '--budget 10' of 'cnnum recover'."
        ) from None


def _decoded(decoder: Decoder, chunk: WholeChunk, path: Path, budget: Budget) -> NDArray[np.void]:
    with _of(path):
        try:
            rows = decoder.messages(chunk.records, budget)
        except SpentError:
            raise
        except CodecError as error:
            raise CodecError(f"'{path}' is not a recording of cnnum: {error}") from None
        budget.take(len(rows))
    return rows


def _repeats_marked(rows: NDArray[np.void], last: NDArray[np.void] | None) -> NDArray[np.void]:
    """Return frames, those flagged as repeats that are the frame before once more, to the bit."""
    before = rows[:1] if last is None else last
    others: Any = np.concatenate([before, rows[:-1]])
    held: Any = rows
    again = (held["sequence"] == others["sequence"]) & (held["time"] == others["time"])
    again &= held["log_time"] == others["log_time"]
    if last is None:
        again[0] = False
    for n in np.flatnonzero(again).tolist():
        again[n] = held["values"][n].tobytes() == others["values"][n].tobytes()
    if not again.any():
        return rows
    marked: Any = rows.copy()
    marked["quality"][again] |= int(Quality.REPEATED)
    return cast("NDArray[np.void]", marked)


def _flagged(rows: NDArray[np.void], last: int) -> NDArray[np.void]:
    """Return frames after a hole, the first of them flagged where scans before it are missing."""
    if int(rows["sequence"][0]) - last in (0, 1):
        return rows
    marked = rows.copy()
    marked["quality"][0] |= int(Quality.DROPPED_BEFORE)
    return marked
