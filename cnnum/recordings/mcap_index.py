"""The index at the end of a recording, made of the chunks that stand in the file."""

import struct
import zlib
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from typing import IO

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, DataEnd, Footer, McapRecord, Statistics, SummaryOffset

from cnnum.recordings.attachments import attached
from cnnum.recordings.chunks import CHANNEL, SCHEMA, channel_of
from cnnum.recordings.layout import Layout
from cnnum.recordings.mcap_records import MAGIC, PREFIX, WholeChunk, built, index_end, records_in
from cnnum.recordings.raw_chunks import RAW_CHANNEL, RAW_SCHEMA, raw_channel
from cnnum.recordings.scan import scan

PART = 1 << 16
"""Bytes of the index that are written at a time."""

_FAR = (1 << 64) - 1

_LOG_TIME = struct.Struct("<Q")


class _Summary:
    """Writes the summary in parts: an index of a long recording is never in memory as a whole."""

    def __init__(self, file: IO[bytes], start: int) -> None:
        self._file, self._start, self._written = file, start, 0
        self._crc = 0
        self._records, self._groups = RecordBuilder(), list[SummaryOffset]()

    @property
    def place(self) -> int:
        """Where the next record comes to stand."""
        return self._start + self._written + self._records.count

    def add(self, record: McapRecord) -> None:
        """Write a record."""
        record.write(self._records)
        if self._records.count >= PART:
            self._flush()

    @contextmanager
    def group(self, opcode: Opcode) -> Generator[None, None, None]:
        """Note where the records of one kind, which the block adds, begin and end."""
        start = self.place
        yield
        self._groups.append(SummaryOffset(opcode, start, self.place - start))

    def close(self) -> None:
        """Write the offsets of the groups, the footer with the checksum, and the magic."""
        offsets = self.place
        for group in self._groups:
            self.add(group)
        self._flush()
        footer = RecordBuilder()
        Footer(self._start, offsets, 0).write(footer)
        data = built(footer)[:-4]
        crc = zlib.crc32(data, self._crc)
        self._file.write(data + struct.pack("<I", crc) + MAGIC)

    def _flush(self) -> None:
        data = built(self._records)
        self._crc = zlib.crc32(data, self._crc)
        self._written += len(data)
        self._file.write(data)


def write_index(file: IO[bytes], layout: Layout) -> None:
    """Append the index of all whole chunks of a file, which ends the recording.

    Parameters
    ----------
    file : binary file
        Open for reading and writing.
    layout : Layout

    Raises
    ------
    OSError
        If it cannot be read or written.
    """
    size = file.seek(0, 2)
    end = RecordBuilder()
    DataEnd(0).write(end)
    file.write(built(end))
    summary, totals = _Summary(file, file.tell()), _Totals()
    with summary.group(Opcode.CHUNK_INDEX):
        for index, number, count in _indexes(file, size):
            file.seek(0, 2)
            summary.add(index)
            totals.add(index, number, count)
    known = [(SCHEMA, channel_of(layout))]
    if RAW_CHANNEL in totals.messages:
        known.append((RAW_SCHEMA, raw_channel()))
    with summary.group(Opcode.SCHEMA):
        for schema, _ in known:
            summary.add(schema)
    with summary.group(Opcode.CHANNEL):
        for _, channel in known:
            summary.add(channel)
    held = list(attached(file, len(MAGIC), size))
    file.seek(0, 2)
    if held:
        with summary.group(Opcode.ATTACHMENT_INDEX):
            for start, stop, one in held:
                summary.add(one.index(start, stop))
    with summary.group(Opcode.STATISTICS):
        summary.add(totals.statistics(len(held)))
    file.seek(0, 2)
    summary.close()


def _indexes(file: IO[bytes], size: int) -> Iterator[tuple[ChunkIndex, int, int]]:
    """Yield the entry of each whole chunk of a file, its channel, and the number of messages."""
    for part in scan(file, size):
        if not isinstance(part, WholeChunk):
            continue
        places = [
            begin + PREFIX.size
            for opcode, begin, _ in records_in(part.records)
            if opcode == Opcode.MESSAGE
        ]
        times = [_LOG_TIME.unpack_from(part.records, place + 6)[0] for place in places]
        channel = int.from_bytes(part.records[places[0] : places[0] + 2], "little")
        behind = index_end(file, part.end, size)
        yield (
            ChunkIndex(
                chunk_length=part.end - part.start,
                chunk_start_offset=part.start,
                compression=part.compression,
                compressed_size=part.packed,
                message_end_time=max(times),
                message_index_length=behind - part.end if behind else 0,
                message_index_offsets={channel: part.end} if behind else {},
                message_start_time=min(times),
                uncompressed_size=len(part.records),
            ),
            channel,
            len(times),
        )


class _Totals:
    """Counts over all chunks of a file."""

    def __init__(self) -> None:
        self.messages = {CHANNEL: 0}
        self._chunks, self._first, self._last = 0, _FAR, 0

    def add(self, index: ChunkIndex, channel: int, count: int) -> None:
        """Count a chunk."""
        self._chunks += 1
        self.messages[channel] = self.messages.get(channel, 0) + count
        self._first = min(index.message_start_time, self._first)
        self._last = max(index.message_end_time, self._last)

    def statistics(self, attachments: int) -> Statistics:
        """Return the counts as the summary holds them."""
        return Statistics(
            attachment_count=attachments,
            channel_count=len(self.messages),
            channel_message_counts=self.messages,
            chunk_count=self._chunks,
            message_count=sum(self.messages.values()),
            message_end_time=self._last,
            message_start_time=self._first,
            metadata_count=0,
            schema_count=len(self.messages),
        )
