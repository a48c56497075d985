"""From frames to a chunk: the bytes that are appended to a file in one write."""

import struct
import zlib
from dataclasses import dataclass

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Header, MessageIndex, Schema

from cnnum.errors import RecordingError
from cnnum.frame import Frame
from cnnum.recordings.layout import Layout
from cnnum.recordings.mcap_records import MAGIC, PREFIX, built
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
"""Of the messages: they are CDR, little-endian."""

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
        Frames of another one are refused.
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
        """Frames that wait."""
        return len(self._index)

    @property
    def size(self) -> int:
        """Bytes that wait."""
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
        """Return the chunk of all frames that wait, with its index, and begin the next."""
        return self.take().chunk()

    def take(self) -> "Waiting":
        """Return all frames that wait, and begin anew."""
        waiting = Waiting(self._opening, b"".join(self._records), tuple(self._index))
        self._records, self._size, self._index = [], 0, []
        return waiting

    def record(self, frame: Frame, log_time: int) -> bytes:
        """Return a frame as the record of a message; arguments and errors are those of `add`."""
        layout = self.layout
        if frame.values.shape != layout.whole:
            raise RecordingError(
                f"A recording holds frames of one shape: expected {layout.whole}, got "
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
