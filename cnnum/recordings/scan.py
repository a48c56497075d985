"""Finding the whole chunks of a file, however damaged the rest of it is."""

import math
import re
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import IO

from mcap.opcode import Opcode

from cnnum.recordings.mcap_records import (
    LARGEST,
    MAGIC,
    PREFIX,
    RECORD,
    Budget,
    WholeChunk,
    index_end,
    read_chunk,
    read_prefix,
    summary_holds,
)

_SMALL = frozenset(Opcode) - {Opcode.CHUNK}
_CONTENT = frozenset((Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE))
_ENDS = frozenset((Opcode.DATA_END, Opcode.FOOTER, Opcode.CHUNK_INDEX, Opcode.STATISTICS))

WINDOW, FIRST_WINDOW = 1 << 20, 1 << 14
"""Bytes that are searched at a time, and at first: the next chunk may be near."""

_BEGIN = re.compile(rb"\x06(?=...[\x00-\x04]\x00\x00\x00\x00)", re.DOTALL)
"""A chunk that is not absurdly long: its opcode, and eight bytes of its length."""


@dataclass(frozen=True, slots=True)
class Hole:
    """A stretch of a file that is no whole record: bytes from `start` to `end`."""

    start: int
    end: int


@dataclass(frozen=True, slots=True)
class End:
    """The end of a file; `indexed` where a whole index stands there."""

    indexed: bool


def scan(
    file: IO[bytes], size: int, budget: Budget | None = None
) -> Iterator[WholeChunk | Hole | End]:
    """Yield the whole chunks of a file and the holes between them in their order, then the end.

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
    end, held, channels, found = place, list[bytes](), set[bytes](), False
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
                found = True
            held.append(record)
        place = end
        if found and (place - begin >= WINDOW):
            yield WholeChunk(begin, place, "", place - begin, b"".join(held))
            begin, held = place, []
    if found and held:
        yield WholeChunk(begin, place, "", place - begin, b"".join(held))
    return place if found else 0


def _follow(file: IO[bytes], place: int, size: int, budget: Budget) -> tuple[int, bool]:
    """Return where the small records from `place` on end, and whether a whole index is there."""
    if place == 0:
        file.seek(0)
        if file.read(len(MAGIC)) != MAGIC:
            return 0, False
        place = len(MAGIC)
    data_end = None
    while found := read_prefix(file, place, size):
        opcode, end = found
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
