"""From frames to a chunk: the bytes that are appended to a file in one write."""

import struct
import zlib
from dataclasses import dataclass

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Chunk, Header, Message, MessageIndex, Schema

from cnnum import __version__
from cnnum.errors import RecordingError
from cnnum.frame import Frame
from cnnum.recordings.layout import Layout
from cnnum.recordings.records import MAGIC, built

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
    ),
)
"""Of the messages: they are CDR, little-endian."""

ENCODING = b"\x00\x01\x00\x00"
"""The first bytes of a CDR message: version 1, little-endian."""

_HEAD = struct.Struct("<4sqdII")
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
        self._records = RecordBuilder()
        self._index: list[tuple[int, int]] = []
        opening = RecordBuilder()
        SCHEMA.write(opening)
        channel_of(layout).write(opening)
        self._opening = built(opening)
        self._tail = struct.Struct(f"<I4x{len(layout.truths)}d" if layout.truths else "<I")

    @property
    def count(self) -> int:
        """Frames that wait."""
        return len(self._index)

    @property
    def size(self) -> int:
        """Bytes that wait."""
        return self._records.count

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
        data = self._encoded(frame)
        if not self._index:
            self._records.write(self._opening)
        self._index.append((log_time, self._records.count))
        Message(
            channel_id=CHANNEL,
            log_time=log_time,
            data=data,
            publish_time=_nanoseconds(frame.time, log_time),
            sequence=frame.sequence & 0xFFFFFFFF,
        ).write(self._records)

    def end(self) -> bytes:
        """Return the chunk of all frames that wait, with its index, and begin the next."""
        return self.take().chunk()

    def take(self) -> "Waiting":
        """Return all frames that wait, and begin anew."""
        waiting = Waiting(self._opening, built(self._records), tuple(self._index))
        self._index = []
        return waiting

    def _encoded(self, frame: Frame) -> bytes:
        layout = self.layout
        if frame.values.shape != layout.whole:
            raise RecordingError(
                f"A recording holds frames of one shape: expected {layout.whole}, got "
                f"{frame.values.shape}; record them to another file."
            )
        known = frame.truth.values if frame.truth else {}
        truth = [known.get(name, np.nan) for name in layout.truths]
        try:
            head = _HEAD.pack(
                ENCODING, frame.sequence, frame.time, int(frame.quality), frame.values.size
            )
        except struct.error as error:
            raise RecordingError(
                f"Scan {frame.sequence} cannot be recorded: {error}; check its driver."
            ) from None
        values = np.ascontiguousarray(frame.values, "<f8").tobytes()
        return b"".join((head, values, self._tail.pack(len(truth), *truth)))


@dataclass(frozen=True, slots=True)
class Waiting:
    """Frames on their way to a file.

    Attributes
    ----------
    opening : bytes
        The records that every chunk begins with.
    records : bytes
        These, then the messages.
    index : tuple of (int, int)
        The host's time of each message in ns, and its place in `records`.
    """

    opening: bytes
    records: bytes
    index: tuple[tuple[int, int], ...]

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
        MessageIndex(CHANNEL, list(self.index)).write(whole)
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
            Waiting(self.opening, self.records[:cut], self.index[:middle]),
            Waiting(self.opening, self.opening + self.records[cut:], rest),
        )


def _nanoseconds(time: float, otherwise: int) -> int:
    """Return the device's time in ns, or the host's where it is none that MCAP has."""
    scaled = time * 1e9
    return round(scaled) if 0 <= scaled <= _LATEST else otherwise
