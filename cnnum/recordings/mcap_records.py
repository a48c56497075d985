"""The records of an MCAP file: damaged ones are refused before they cost memory."""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import IO, Any, cast

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

from cnnum.errors import CodecError

MAGIC = b"\x89MCAP0\r\n"

LARGEST = 64 << 20
"""Bytes of a chunk, at most, packed or unpacked: the memory that reading may take."""

PREFIX = struct.Struct("<BQ")
"""Prefix of every record: its opcode, and the number of bytes that follow."""

_CHUNK = struct.Struct("<BQQQQII")
_SIZE = struct.Struct("<Q")
_LONGEST_NAME = 16
_FOOTER = struct.Struct("<QQI")


INSIDE_CHUNKS = frozenset((Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE))

RECORD = 1024
"""Bytes that are read and summed in the time that one small record takes."""


class SpentError(CodecError):
    """A file takes more than its budget."""


class Budget:
    """What reading a file may take: work in bytes that are looked at, bytes unpacked, and frames.

    A recording takes little more than its own bytes. A file that was made to keep its reader busy
    takes a thousand times as much, and is refused.

    Parameters
    ----------
    size : int
        Size of the file, bytes.
    factor : float
        How many times as much as usual it may take.
    """

    __slots__ = ("_frames", "_unpacked", "_work")

    def __init__(self, size: int, factor: float = 1.0) -> None:
        self._work = factor * ((256 << 20) + 512.0 * size)
        self._unpacked = factor * (4.0 * LARGEST + 64.0 * size)
        self._frames = factor * (1e5 + size / 4.0)

    def look(self, count: int) -> None:
        """Take as many bytes as are looked at.

        Raises
        ------
        SpentError
            If there are no more; so do the other methods.
        """
        self._work -= count
        if self._work < 0.0:
            raise SpentError("reading it takes far longer than a recording of its size may take")

    def unpack(self, count: int) -> None:
        """Take as many bytes as are unpacked."""
        self.look(count)
        self._unpacked -= count
        if self._unpacked < 0.0:
            raise SpentError("it unpacks to far more bytes than a recording of its size may hold")

    def take(self, frames: int) -> None:
        """Take as many frames."""
        self._frames -= frames
        if self._frames < 0.0:
            raise SpentError("it holds far more frames than a recording of its size may hold")


@dataclass(frozen=True, slots=True)
class WholeChunk:
    """A chunk whose checksum holds.

    Attributes
    ----------
    start, end : int
        Its place in the file, bytes.
    compression : str
    packed : int
        Bytes of its records in the file.
    records : bytes
        Unpacked.
    """

    start: int
    end: int
    compression: str
    packed: int
    records: bytes


def built(builder: RecordBuilder) -> bytes:
    """Return the bytes of the records in a builder, and empty it."""
    data: bytes = cast(Any, builder).end()
    return data


def read_chunk(
    file: IO[bytes], place: int, size: int, budget: Budget | None = None
) -> WholeChunk | None:
    """Return the chunk that begins at `place`, None if no whole one does.

    Parameters
    ----------
    file : binary file
    place, size : int
        Where to look, and the end of the file, bytes.
    budget : Budget, optional
        Budget of what is read and unpacked.
    """
    file.seek(place)
    if budget is not None:
        budget.look(RECORD)
    head = file.read(_CHUNK.size + _LONGEST_NAME + _SIZE.size)
    if len(head) < _CHUNK.size + _SIZE.size:
        return None
    opcode, length, _, _, unpacked, crc, name_size = _CHUNK.unpack_from(head)
    begin = _CHUNK.size + name_size + _SIZE.size
    if opcode != Opcode.CHUNK or name_size > _LONGEST_NAME or begin > len(head):
        return None
    name = head[_CHUNK.size : _CHUNK.size + name_size]
    (packed,) = _SIZE.unpack_from(head, begin - _SIZE.size)
    end = place + PREFIX.size + length
    if end > size or max(packed, unpacked) > LARGEST or end != place + begin + packed:
        return None
    if budget is not None:
        budget.look(packed)
        if name:
            budget.unpack(unpacked)
    file.seek(place + begin)
    records = _unpacked(name, file.read(packed), unpacked)
    # a checksum of 0 means that the writer made none
    if records is None or not (zlib.crc32(records) == crc if crc else _are_records(records)):
        return None
    return WholeChunk(place, end, name.decode("ascii"), packed, records)


def _are_records(data: bytes) -> bool:
    try:
        return all(opcode in INSIDE_CHUNKS for opcode, _, _ in records_in(data))
    except CodecError:
        return False


def _unpacked(name: bytes, data: bytes, size: int) -> bytes | None:
    """Return `size` bytes that `data` holds; no more than one byte beyond is ever unpacked."""
    records: bytes | None = None
    if name == b"":
        records = data
    elif name == b"zstd":
        records = _zstd(data, size + 1)
    elif name == b"lz4":
        records = _lz4(data, size + 1)
    return records if records is not None and len(records) == size else None


def _zstd(data: bytes, most: int) -> bytes | None:
    import zstandard

    unpacker = zstandard.ZstdDecompressor(max_window_size=LARGEST)
    try:
        return unpacker.stream_reader(data).read(most)
    except zstandard.ZstdError:
        return None


def _lz4(data: bytes, most: int) -> bytes | None:
    unpacker: Any = import_module("lz4.frame").LZ4FrameDecompressor()  # it has no types
    try:
        return cast(bytes, unpacker.decompress(data, max_length=most))
    except (RuntimeError, EOFError):
        return None


def read_prefix(file: IO[bytes], place: int, size: int) -> tuple[int, int] | None:
    """Return opcode and end of the record at `place`, None if none ends within `size`."""
    file.seek(place)
    head = file.read(PREFIX.size)
    if len(head) < PREFIX.size:
        return None
    opcode, length = PREFIX.unpack(head)
    end = place + PREFIX.size + length
    return (opcode, end) if end <= size else None


def index_end(file: IO[bytes], place: int, size: int) -> int | None:
    """Return the end of the index of messages at `place`, None if no whole one is."""
    result = read_prefix(file, place, size)
    if result is None or result[0] != Opcode.MESSAGE_INDEX:
        return None
    inside = file.read(6)
    length = result[1] - place - PREFIX.size
    entries = int.from_bytes(inside[2:], "little")
    return result[1] if entries % 16 == 0 and length == 6 + entries else None


def summary_holds(file: IO[bytes], data_end: int, footer: int, size: int) -> bool:
    """Return whether the file ends in a summary whose checksum holds.

    Parameters
    ----------
    file : binary file
    data_end, footer, size : int
        End of the record that closes the data, begin of the footer, end of the file; bytes.
    """
    if size != footer + PREFIX.size + _FOOTER.size + len(MAGIC):
        return False
    file.seek(footer + PREFIX.size)
    start, _, crc = _FOOTER.unpack(file.read(_FOOTER.size))
    if file.read(len(MAGIC)) != MAGIC or start not in (0, data_end):
        return False
    if not start or not crc:  # a file without a summary, or whose writer made no checksum of it
        return True
    file.seek(start)
    seen, left = 0, footer + PREFIX.size + _FOOTER.size - 4 - start
    while left:
        part = file.read(min(left, 1 << 20))
        seen, left = zlib.crc32(part, seen), left - len(part)
        if not part:
            return False
    return bool(seen == crc)


def records_in(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, begin and end of the records of an unpacked chunk; the begin is the prefix's.

    Raises
    ------
    CodecError
        If they are torn.
    """
    place = 0
    while place < len(data):
        if place + PREFIX.size > len(data):
            raise CodecError("one of its chunks is cut off.")
        opcode, length = PREFIX.unpack_from(data, place)
        end = place + PREFIX.size + length
        if end > len(data):
            raise CodecError("one of its chunks is cut off.")
        yield opcode, place, end
        place = end


class Fields:
    """Reads the fields of one record, never beyond it.

    Raises
    ------
    CodecError
        If a field reaches beyond the record.
    """

    def __init__(self, data: bytes) -> None:
        self._data, self._place = data, 0

    def number(self, size: int) -> int:
        """Return an unsigned number of that many bytes."""
        return int.from_bytes(self._bytes(size), "little")

    def text(self) -> str:
        """Return a string."""
        try:
            return self._bytes(self.number(4)).decode()
        except UnicodeDecodeError:
            raise CodecError("a name in it is not text.") from None

    def raw(self, size: int) -> bytes:
        """Return that many bytes."""
        return self._bytes(size)

    def mapping(self) -> dict[str, str]:
        """Return a map of strings."""
        end = self.number(4) + self._place
        held: dict[str, str] = {}
        while self._place < end:
            key = self.text()
            held[key] = self.text()
        return held

    def _bytes(self, size: int) -> bytes:
        part = self._data[self._place : self._place + size]
        if len(part) < size:
            raise CodecError("one of its records is cut off.")
        self._place += size
        return part
