"""Bytes as they came from a port, next to the frames that were decoded from them."""

import struct
from collections.abc import Iterator

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from cnnum.recordings.chunks import ENCODING, Waiting
from cnnum.recordings.mcap_records import PREFIX, built, records_in

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
        """Messages that wait."""
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
        """Return all bytes that wait, and begin anew."""
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
