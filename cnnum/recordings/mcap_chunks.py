"""Encoding of frames as chunks, each appended to a file in one write, and decoding."""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Header, MessageIndex, Schema
from numpy.typing import NDArray

from cnnum.errors import CodecError, RecordingError
from cnnum.frame import Frame, Quality, Truth
from cnnum.recordings.layout import Layout
from cnnum.recordings.mcap_records import MAGIC, PREFIX, RECORD, Budget, Fields, built, records_in
from cnnum.version import __version__

CHANNEL = 1
TOPIC = "/taxels"

SCHEMA = Schema(
    id=1,
    name="cnnum_msgs/msg/TaxelFrame",
    encoding="ros2msg",
    data=(
        b"# One scan of a tactile array; rows, columns and channels are in the channel's metadata\n"
        b"int64 sequence\n"
        b"float64 time\n"
        b"uint32 quality\n"
        b"float64[] values\n"
        b"float64[] truth\n"
        b"bool[] saturated\n"
    ),
)
"""Encoding of the messages, which are little-endian CDR."""

ENCODING = b"\x00\x01\x00\x00"
"""The first bytes of a CDR message: version 1, little-endian."""

_MESSAGE = struct.Struct("<BQHIQQ4sqdII")
"""A message's record up to its values, in one step; the library's class takes one a field."""

MESSAGE_HEAD = struct.calcsize("<BQHIQQ")
"""Bytes of a message's record before its CDR data."""

CHUNK_BYTES = 1 << 20
"""A chunk is written before its time when it is as large as this."""

_LATEST = (1 << 63) - 1


def channel_of(layout: Layout) -> Channel:
    """Return the MCAP channel of a recording."""
    return Channel(
        id=CHANNEL,
        topic=TOPIC,
        message_encoding="cdr",
        metadata=layout.metadata(),
        schema_id=SCHEMA.id,
    )


def beginning() -> bytes:
    """Return the first bytes of a file, before its chunks."""
    head = RecordBuilder()
    Header(profile="", library=f"cnnum {__version__}").write(head)
    return MAGIC + built(head)


class ChunkMaker:
    """Collects frames until they are wanted as the bytes of one chunk.

    Parameters
    ----------
    layout : Layout
        Layout of all frames; others raise an error.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self._records: list[bytes] = []
        self._size = 0
        self._index: list[tuple[int, int]] = []
        opening = RecordBuilder()
        SCHEMA.write(opening)
        channel_of(layout).write(opening)
        self._opening = built(opening)
        self._length = layout.message.itemsize - PREFIX.size
        self._tail = struct.Struct(f"<I4x{len(layout.truths)}d" if layout.truths else "<I")
        self._taxels = layout.shape[0] * layout.shape[1]

    @property
    def count(self) -> int:
        """Number of pending frames."""
        return len(self._index)

    @property
    def size(self) -> int:
        """Number of pending bytes."""
        return self._size

    def add(self, frame: Frame, log_time: int) -> None:
        """Take in a frame.

        Parameters
        ----------
        frame : Frame
        log_time : int, ns
            When it came, by the host's clock.

        Raises
        ------
        RecordingError
            If it has another shape than the first frame, or numbers that no recording holds.
        """
        record = self.record(frame, log_time)
        if not self._index:
            self._records, self._size = [self._opening], len(self._opening)
        self._index.append((log_time, self._size))
        self._records.append(record)
        self._size += len(record)

    def end(self) -> bytes:
        """Return the chunk of all pending frames, with its index, and begin the next."""
        return self.take().chunk()

    def take(self) -> "Waiting":
        """Return all pending frames and start over."""
        waiting = Waiting(self._opening, b"".join(self._records), tuple(self._index))
        self._records, self._size, self._index = [], 0, []
        return waiting

    def record(self, frame: Frame, log_time: int) -> bytes:
        """Return a frame as the record of a message; arguments and errors are those of `add`."""
        layout = self.layout
        if frame.values.shape != layout.whole:
            raise RecordingError(
                f"A recording can contain frames of only one shape: expected {layout.whole}, got "
                f"{frame.values.shape}; record them to another file."
            )
        try:
            head = _MESSAGE.pack(
                Opcode.MESSAGE,
                self._length,
                CHANNEL,
                frame.sequence & 0xFFFFFFFF,
                log_time,
                _nanoseconds(frame.time, log_time),
                ENCODING,
                frame.sequence,
                frame.time,
                frame.quality,
                layout.values,
            )
        except struct.error as error:
            raise RecordingError(
                f"Scan {frame.sequence} cannot be recorded: {error}; check its driver."
            ) from None
        values = frame.values.astype("<f8", copy=False).tobytes()
        return b"".join((head, values, self._truth(frame), self._marks(frame)))

    def _truth(self, frame: Frame) -> bytes:
        names = self.layout.truths
        known = frame.truth.values if frame.truth else {}
        if tuple(known) == names:
            return self._tail.pack(len(names), *known.values())
        return self._tail.pack(len(names), *(known.get(name, np.nan) for name in names))

    def _marks(self, frame: Frame) -> bytes:
        if not self.layout.marks:
            return b""
        at_end = frame.saturated
        marks = bytes(self._taxels) if at_end is None else at_end.astype(np.bool_).tobytes()
        return self._taxels.to_bytes(4, "little") + marks


@dataclass(frozen=True, slots=True)
class Waiting:
    """Frames on their way to a file.

    Attributes
    ----------
    opening, records : bytes
        The records that every chunk begins with; these, then the messages.
    index : tuple of (int, int)
        The host's time of each message in ns, and its place in `records`.
    channel : int
        Channel of all these messages.
    """

    opening: bytes
    records: bytes
    index: tuple[tuple[int, int], ...]
    channel: int = CHANNEL

    def chunk(self) -> bytes:
        """Return the frames as one chunk, with its index."""
        times = [log_time for log_time, _ in self.index]
        whole = RecordBuilder()
        Chunk(
            compression="",
            data=self.records,
            message_start_time=min(times),
            message_end_time=max(times),
            uncompressed_crc=zlib.crc32(self.records),
            uncompressed_size=len(self.records),
        ).write(whole)
        MessageIndex(self.channel, list(self.index)).write(whole)
        return built(whole)

    def halves(self) -> "tuple[Waiting, ...]":
        """Return the first and the second half of the frames; nothing where there is but one."""
        if len(self.index) < 2:
            return ()
        middle = len(self.index) // 2
        cut = self.index[middle][1]
        shift = cut - len(self.opening)
        rest = tuple((log_time, place - shift) for log_time, place in self.index[middle:])
        return (
            Waiting(self.opening, self.records[:cut], self.index[:middle], self.channel),
            Waiting(self.opening, self.opening + self.records[cut:], rest, self.channel),
        )


def untimed(time: float) -> int:
    """Return the log time of a frame that does not say when it came: its own time, ns."""
    scaled = time * 1e9
    return round(scaled) if 0 <= scaled <= _LATEST else 0


def _nanoseconds(time: float, otherwise: int) -> int:
    """Return the device's time in ns, or the host's where it is none that MCAP has."""
    scaled = time * 1e9
    return round(scaled) if 0 <= scaled <= _LATEST else otherwise


RAW_CHANNEL = 2
RAW_TOPIC = "/raw"

RAW_SCHEMA = Schema(
    id=2,
    name="cnnum_msgs/msg/RawBytes",
    encoding="ros2msg",
    data=b"# Bytes of a tactile array in the order in which they came\nuint8[] data\n",
)

_HEAD = struct.Struct("<BQHIQQ4sI")


def raw_channel() -> Channel:
    """Return the MCAP channel of the bytes."""
    return Channel(
        id=RAW_CHANNEL,
        topic=RAW_TOPIC,
        message_encoding="cdr",
        metadata={},
        schema_id=RAW_SCHEMA.id,
    )


def _opening() -> bytes:
    opening = RecordBuilder()
    RAW_SCHEMA.write(opening)
    raw_channel().write(opening)
    return built(opening)


OPENING = _opening()
"""The records that every chunk of bytes begins with."""

_NUMBER = RAW_CHANNEL.to_bytes(2, "little")


class RawMaker:
    """Collects bytes until they are wanted as one chunk."""

    def __init__(self) -> None:
        self._records: list[bytes] = []
        self._index: list[tuple[int, int]] = []
        self.size = self._number = 0

    @property
    def count(self) -> int:
        """Number of pending messages."""
        return len(self._index)

    def add(self, data: bytes, log_time: int) -> None:
        """Take in bytes that came at a time, ns."""
        if not self._index:
            self._records, self.size = [OPENING], len(OPENING)
        length = _HEAD.size - PREFIX.size + len(data)
        head = _HEAD.pack(
            Opcode.MESSAGE,
            length,
            RAW_CHANNEL,
            self._number & 0xFFFFFFFF,
            log_time,
            log_time,
            ENCODING,
            len(data),
        )
        self._index.append((log_time, self.size))
        self._records += [head, data]
        self.size += len(head) + len(data)
        self._number += 1

    def take(self) -> Waiting:
        """Return all pending bytes and start over."""
        waiting = Waiting(OPENING, b"".join(self._records), tuple(self._index), RAW_CHANNEL)
        self._records, self.size, self._index = [], 0, []
        return waiting


def is_raw(records: bytes) -> bool:
    """Return whether a chunk holds such bytes and nothing else."""
    return records.startswith(OPENING) and all(
        records[begin + PREFIX.size : begin + PREFIX.size + 2] == _NUMBER
        for opcode, begin, _ in records_in(records)
        if opcode == Opcode.MESSAGE
    )


def raw_of(records: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the times, in ns, and the bytes of a chunk."""
    for opcode, begin, end in records_in(records):
        if opcode == Opcode.MESSAGE:
            *_, log_time, _, _, _ = _HEAD.unpack_from(records, begin)
            yield log_time, records[begin + _HEAD.size : end]


INSIDE = RECORD // 4
"""Bytes that are read and summed in the time that one record of an unpacked chunk takes."""

NO_FRAMES = np.dtype([("sequence", np.int64)])
"""Type of the frames in a chunk of raw bytes, which has none."""


@dataclass(frozen=True, slots=True)
class Topic:
    """A channel of a file whose messages are frames."""

    channel: int
    layout: Layout


class Decoder:
    """Reads chunks in sequence; the layout of the first applies to all.

    A file that another program has packed anew may name the channel in its first chunk alone.
    """

    def __init__(self) -> None:
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, bytes] = {}
        self._topic: Topic | None = None

    @property
    def layout(self) -> Layout | None:
        """The layout that all frames share, None before the first chunk."""
        return self._topic.layout if self._topic else None

    def messages(self, records: bytes, budget: Budget | None = None) -> NDArray[np.void]:
        """Return the frames of a chunk as rows of `Layout.message`.

        Parameters
        ----------
        records : bytes
        budget : Budget, optional
            Budget of the work.

        Raises
        ------
        CodecError
            If they are none of a recording, or of another one than those before; or if the budget
            is spent.
        """
        if is_raw(records):
            return np.empty(0, NO_FRAMES)
        parts, tried = list[bytes](), False
        for opcode, begin, end in records_in(records):
            if budget is not None:
                budget.look(INSIDE)
            if not tried and opcode == Opcode.MESSAGE and self._is_ours(records[begin:end]):
                tried, rest = True, self._all_of_it(records, begin)
                if rest is not None:
                    return rest
            data = records[begin + PREFIX.size : end] if opcode != Opcode.MESSAGE else b""
            if opcode == Opcode.SCHEMA:
                fields = Fields(data)
                number = fields.number(2)
                self._schemas[number] = fields.text()
            elif opcode == Opcode.CHANNEL:
                self._meet(data)
            elif opcode == Opcode.MESSAGE and self._is_ours(records[begin:end]):
                parts.append(records[begin:end])
        if self._topic is None:
            raise CodecError(f"it has no messages of the kind '{SCHEMA.name}'.")
        return _rows(b"".join(parts), len(parts), self._topic.layout)

    def _all_of_it(self, records: bytes, begin: int) -> NDArray[np.void] | None:
        """Return the rest of a chunk where it is frames alone, as in the files that we write."""
        if self._topic is None or (len(records) - begin) % self._topic.layout.message.itemsize:
            return None
        rows: Any = np.frombuffer(records, self._topic.layout.message, offset=begin)
        ours = (rows["opcode"] == Opcode.MESSAGE) & (rows["channel"] == self._topic.channel)
        return cast("NDArray[np.void]", rows) if _fit(rows, self._topic.layout, ours) else None

    def _meet(self, data: bytes) -> None:
        """Take in a channel; the bytes of one that is known already are not read again."""
        number = int.from_bytes(data[:2], "little")
        if self._channels.get(number) == data:
            return
        self._channels[number] = data
        fields = Fields(data)
        fields.number(2)
        schema = fields.number(2)
        fields.text()
        encoding, metadata = fields.text(), fields.mapping()
        if self._schemas.get(schema) != SCHEMA.name:
            return
        if encoding != "cdr":
            raise CodecError(f"its messages must be 'cdr', got {encoding!r:.60}.")
        met = Topic(number, Layout.from_metadata(metadata))
        if self._topic not in (None, met):
            raise CodecError("it contains frames of two arrays.")
        self._topic = met

    def _is_ours(self, message: bytes) -> bool:
        number = int.from_bytes(message[PREFIX.size : PREFIX.size + 2], "little")
        return self._topic is not None and number == self._topic.channel


def _rows(data: bytes, count: int, layout: Layout) -> NDArray[np.void]:
    form = layout.message
    if len(data) != count * form.itemsize:
        raise CodecError("one of its messages does not have the length of a frame.")
    rows: Any = np.frombuffer(data, form)
    if not _fit(rows, layout):
        raise CodecError("one of its messages is not a frame of its array.")
    return cast("NDArray[np.void]", rows)


def _fit(rows: Any, layout: Layout, ours: Any = True) -> bool:
    """Return whether all rows are `ours`, and as long as frames of this layout."""
    expected: dict[str, Any] = {
        "encoding": np.void(ENCODING),
        "length": layout.message.itemsize - PREFIX.size,
        "count": layout.values,
        "truths": len(layout.truths),
    }
    if layout.marks:
        expected["taxels"] = layout.shape[0] * layout.shape[1]
    fit = [(rows[name] == value).all() for name, value in expected.items()]
    return bool(np.all(ours) and all(fit))


def marks_of(rows: NDArray[np.void], layout: Layout) -> NDArray[np.bool_]:
    """Return (frames, rows, cols): the taxels at an end of their range, none if it is not known."""
    if not layout.marks:
        return np.zeros((len(rows), *layout.shape), np.bool_)
    held: Any = rows
    return np.asarray(held["saturated"] != 0)


def frames_of(rows: NDArray[np.void], layout: Layout) -> Iterator[tuple[Frame, int]]:
    """Yield frames, and the host's time of each in ns."""
    held: Any = rows
    values = np.ascontiguousarray(held["values"], np.float64)
    columns = ("sequence", "time", "quality", "log_time")
    truths = held["truth"].tolist() if layout.truths else [None] * len(rows)
    facts = zip(*(held[name].tolist() for name in columns), truths, strict=True)
    marks = marks_of(rows, layout)
    some: list[bool] = np.asarray(marks.any(axis=(1, 2))).tolist()
    marked = (at_end if known else None for at_end, known in zip(marks, some, strict=True))
    for cells, at_end, (sequence, time, quality, log_time, truth) in zip(
        values, marked, facts, strict=True
    ):
        known = None if truth is None else Truth(dict(zip(layout.truths, truth, strict=True)))
        frame = Frame(
            values=cells,
            channels=layout.channels,
            unit=layout.unit,
            sequence=sequence,
            time=time,
            quality=Quality(quality),
            truth=known,
            calibration=layout.calibration_id,
            saturated=at_end,
            wall_ns=None if log_time == untimed(time) else log_time,
        )
        yield frame, log_time
