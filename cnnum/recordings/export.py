"""Export of chunks to the requested file: MCAP with an index, NumPy, CSV or HDF5."""

import contextlib
import csv
import io
import os
import struct
import zipfile
import zlib
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, DataEnd, Footer, McapRecord, Statistics, SummaryOffset
from numpy.typing import NDArray

from cnnum.errors import RecordingError, missing_extra, name_error
from cnnum.frame import Frame
from cnnum.recordings.layout import Layout, attached, records
from cnnum.recordings.mcap_chunks import (
    CHANNEL,
    CHUNK_BYTES,
    RAW_CHANNEL,
    RAW_SCHEMA,
    SCHEMA,
    ChunkMaker,
    RawMaker,
    beginning,
    channel_of,
    marks_of,
    raw_channel,
)
from cnnum.recordings.mcap_records import MAGIC, PREFIX, WholeChunk, built, index_end, records_in
from cnnum.recordings.reader import Contents, scan
from cnnum.safety.files import beside, sentences, written

if TYPE_CHECKING:
    from typing_extensions import Buffer


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
        """Offset of the next record."""
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
            for start, stop, chunk in held:
                summary.add(chunk.index(start, stop))
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


def write_mcap(file: IO[bytes], contents: Contents) -> None:
    """Write files, frames and raw bytes to chunks anew, and the index.

    Raises
    ------
    OSError
        If there is no room.
    RecordingError, CodecError
        If the recording can no longer be read.
    """
    file.write(beginning() + records(contents.held))
    layout = replace(contents.layout, marks=True)
    maker, raw = ChunkMaker(layout), RawMaker()
    for frame, log_time in contents.stored():
        maker.add(frame, log_time)
        if maker.size >= CHUNK_BYTES:
            file.write(maker.end())
    if maker.count:
        file.write(maker.end())
    for log_time, data in contents.raw():
        raw.add(data, log_time)
        if raw.size >= CHUNK_BYTES:
            file.write(raw.take().chunk())
    if raw.count:
        file.write(raw.take().chunk())
    write_index(file, layout)


CSV_MARKS = "saturated"
"""A column: the taxels at an end of their range, as in "r0_c3 r1_c3"."""

CSV_CAME, RATE = "log time (ns)", "rate (Hz)"
"""The last columns: when a frame came, by the time of day; and the rate, the same in all rows."""

PADS = "pads"
"""A column after them, the same in all rows, where the pads are known."""


def write_table(file: IO[bytes], contents: Contents) -> None:
    """Write sequence, time, flags, then every cell's channels, the ground truth, marks and more.

    Numbers stand in the shortest form that is read back as the same.

    It raises as `write_mcap`.
    """
    text = io.TextIOWrapper(file, encoding="utf-8", newline="", write_through=True)
    try:
        writer = csv.writer(text)
        writer.writerow(_header(contents.layout))
        writer.writerows(_rows(contents))
    finally:
        text.detach()


def _header(layout: Layout) -> list[str]:
    rows, cols = layout.shape
    cells = [
        f"r{row}_c{col}_{channel} ({layout.unit})"
        for row in range(rows)
        for col in range(cols)
        for channel in layout.channels
    ]
    return [
        "sequence",
        "time (s)",
        "quality",
        *cells,
        *(f"truth {n}" for n in layout.truths),
        CSV_MARKS,
        CSV_CAME,
        RATE,
        *([PADS] if layout.pads is not None else []),
    ]


def _rows(contents: Contents) -> Iterator[list[object]]:
    rate, pads = repr(contents.layout.rate), contents.layout.pads
    last = [rate] if pads is None else [rate, pads]
    for frame, came in contents.stored():
        head = [frame.sequence, repr(frame.time), int(frame.quality)]
        yield [*head, *_cells(frame), came, *last]


def marked_text(marks: NDArray[np.bool_] | None) -> str:
    """Return the names of the taxels at an end of their range."""
    at_end = [] if marks is None else np.argwhere(marks).tolist()
    return " ".join(f"r{row}_c{col}" for row, col in at_end)


def _cells(frame: Frame) -> Iterator[object]:
    yield from (repr(value) for value in frame.values.ravel().tolist())
    if frame.truth:
        yield from frame.truth.values.values()
    yield marked_text(frame.saturated)


KIND = "cnnum recording 1"

FRAMES = ("values", "sequence", "time", "quality", "truth")
"""Members with one row per frame."""

MARKS = "saturated"
"""Another one, (frames, rows, cols): taxels at an end of their range. It was not always there."""

CAME = "log_time"
"""And another, (frames,): when each came by the time of day, ns. It was not always there, either.
"""

CALIBRATION = ("alpha_normal", "beta_ns", "limit", "offsets", "cross", "drift")
"""Fields of a calibration that are members; its depth and heat are, too."""


def write_archive(file: IO[bytes], contents: Contents) -> None:
    """Write the archive that `cnnum.drivers.npz_file` reads.

    The recording is read once for each member with one row per frame, one chunk at a time.

    It raises as `write_mcap`.
    """
    layout = contents.layout
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        for name, value in _facts(contents).items():
            _member(archive, name, np.asarray(value))
        shapes = {"values": layout.whole, "truth": (len(layout.truths),)}
        for name in (*FRAMES, CAME):
            shape = (contents.frames, *shapes.get(name, ()))
            kind = np.dtype(np.int64 if name in ("sequence", "quality", CAME) else np.float64)
            _stream(archive, name, shape, kind, _columns(contents, name, kind))
        marks = (marks_of(rows, layout).tobytes() for rows in contents.chunks())
        _stream(archive, MARKS, (contents.frames, *layout.shape), np.dtype(np.bool_), marks)


def _facts(contents: Contents) -> dict[str, Any]:
    layout = contents.layout
    facts: dict[str, Any] = {
        "kind": KIND,
        "channels": list(layout.channels),
        "unit": layout.unit,
        "rate": layout.rate,
        "truths": np.array(layout.truths, dtype=np.str_),
    }
    if layout.pads is not None:
        facts[PADS] = layout.pads
    known = layout.calibrated(contents.path)
    if known is not None:
        parts: dict[str, Any] = {name: getattr(known, name) for name in CALIBRATION}
        parts["depth"] = np.nan if known.depth is None else known.depth
        parts["heat"] = [known.heat.amplitude, known.heat.time_constant]
        facts |= {f"calibration_{name}": value for name, value in parts.items()}
    return facts


def _columns(contents: Contents, name: str, kind: np.dtype[Any]) -> Iterator[bytes]:
    for rows in contents.chunks():
        held: Any = rows
        if name == "truth" and not contents.layout.truths:
            continue
        yield np.ascontiguousarray(held[name], kind).tobytes()


def _member(archive: zipfile.ZipFile, name: str, value: NDArray[Any]) -> None:
    _stream(archive, name, value.shape, value.dtype, [value.tobytes()])


def _stream(
    archive: zipfile.ZipFile,
    name: str,
    shape: tuple[int, ...],
    kind: np.dtype[Any],
    parts: Iterable[bytes],
) -> None:
    head = {
        "descr": np.lib.format.dtype_to_descr(kind),
        "fortran_order": False,
        "shape": shape,
    }
    with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
        np.lib.format.write_array_header_1_0(member, head)
        for part in parts:
            member.write(part)


HDF5_KIND = "cnnum recording 1"


def write_hdf5(file: IO[bytes], contents: Contents) -> None:
    """Write ``values`` (frames, rows, cols, channels), ``saturated``, and numbers by frame.

    ``saturated`` (frames, rows, cols) are the taxels at an end of their range. The numbers are
    ``time`` (s), ``log_time`` (ns), ``sequence``, ``quality`` and ``truth/NAME``. Attributes say
    the rest. A chunk of the recording at a time is held.

    Raises
    ------
    MissingExtraError
        If h5py is not installed.
    OSError
        If there is no room.
    RecordingError, CodecError
        If the recording can no longer be read.
    """
    try:
        h5py: Any = import_module("h5py")
    except ImportError:
        raise missing_extra("HDF5 files", "h5py", "hdf5") from None
    layout, steady = contents.layout, _Steady(file)
    with h5py.File(steady, "w") as target:
        target.attrs.update(
            {
                "kind": HDF5_KIND,
                "channels": list(layout.channels),
                "unit": layout.unit,
                "rate": layout.rate,
                "calibration": layout.calibration,
            }
        )
        if layout.pads is not None:
            target.attrs[PADS] = layout.pads
        sets = _sets(target, contents)
        at = 0
        for rows in contents.chunks():
            held: Any = rows
            part = slice(at, at + len(rows))
            for name in ("values", "time", "log_time", "sequence", "quality"):
                sets[name][part] = held[name]
            sets["saturated"][part] = marks_of(rows, layout)
            for number, name in enumerate(layout.truths):
                sets[f"truth/{name}"][part] = held["truth"][:, number]
            at += len(rows)
            if steady.error is not None:
                break
    if steady.error is not None:
        raise steady.error


class _Steady(io.RawIOBase):
    """A file whose writes never fail: HDF5 ends the process that has a full disk below it.

    What no longer fits is held in memory, so that HDF5 reads what it wrote and can close the file.
    The first error is kept, and whoever writes stops by it.
    """

    def __init__(self, file: IO[bytes]) -> None:
        super().__init__()
        self._handle, self._at, self._end = file.fileno(), 0, 0
        self._late: list[tuple[int, bytes]] = []
        self.error: OSError | None = None

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._at

    def seek(self, offset: int, whence: int = 0) -> int:
        self._at = offset + (0, self._at, self._end)[whence]
        return self._at

    def truncate(self, size: int | None = None) -> int:
        self._end = self._at if size is None else size
        try:
            os.ftruncate(self._handle, self._end)
        except OSError as error:
            self.error = self.error or error
        return self._end

    def readinto(self, buffer: "Buffer") -> int:
        view = memoryview(buffer).cast("B")
        count = max(0, min(len(view), self._end - self._at))
        os.lseek(self._handle, self._at, os.SEEK_SET)
        got = os.read(self._handle, count) if count else b""
        view[:count] = got + bytes(count - len(got))
        for at, late in self._late:
            first, last = max(at, self._at), min(at + len(late), self._at + count)
            if first < last:
                view[first - self._at : last - self._at] = late[first - at : last - at]
        self._at += count
        return count

    def write(self, data: "Buffer") -> int:
        view = memoryview(data).cast("B")
        try:
            os.lseek(self._handle, self._at, os.SEEK_SET)
            done = 0
            while self.error is None and done < len(view):
                done += os.write(self._handle, view[done:])
        except OSError as error:
            self.error = error
        if self.error is not None:
            self._late.append((self._at, bytes(view)))
        self._at += len(view)
        self._end = max(self._end, self._at)
        return len(view)


def _sets(target: Any, contents: Contents) -> dict[str, Any]:
    """Return the empty arrays of a file by name."""
    layout, frames = contents.layout, contents.frames
    kinds: dict[str, Any] = {
        "time": np.float64,
        "log_time": np.int64,
        "sequence": np.int64,
        "quality": np.uint32,
        **{f"truth/{name}": np.float64 for name in layout.truths},
    }
    result = {name: target.create_dataset(name, (frames,), kind) for name, kind in kinds.items()}
    maps = (("values", layout.whole, np.float64), ("saturated", layout.shape, np.bool_))
    for name, shape, kind in maps:
        result[name] = target.create_dataset(
            name,
            (frames, *shape),
            kind,
            chunks=(min(256, frames), *shape),
            compression="gzip",
            shuffle=True,
        )
    return result


WRITERS: Mapping[str, Callable[[IO[bytes], Contents], None]] = {
    ".mcap": write_mcap,
    ".npz": write_archive,
    ".csv": write_table,
    ".h5": write_hdf5,
    ".hdf5": write_hdf5,
}
"""By the suffix of the file."""


def suffix_of(target: Path) -> str:
    """Return the suffix that names the kind of recording of a file.

    Raises
    ------
    UnknownNameError
        If it is none of `WRITERS`.
    MissingExtraError
        If its library is not installed: better before frames are recorded than after it.
    """
    suffix = target.suffix.lower()
    if suffix not in WRITERS:
        raise name_error("kind of recording", suffix or target.name, WRITERS)
    if WRITERS[suffix] is write_hdf5 and find_spec("h5py") is None:
        raise missing_extra("HDF5 files", "h5py", "hdf5")
    return suffix


def export(contents: Contents, target: Path, *, force: bool = False) -> None:
    """Write the frames of a recording to another file, which appears when it is whole.

    The calibration of an array goes into a file next to a CSV file, which has no place for it.

    Parameters
    ----------
    contents : Contents
    target : Path
        Its suffix names the kind of file.
    force : bool
        Whether a file that is there already is replaced.

    Raises
    ------
    UnknownNameError
        If the suffix is none of `WRITERS`.
    RecordingError
        If there is such a file, or no room, or the recording can no longer be read.
    CodecError
        If the recording is none.
    """
    suffix, calibration = suffix_of(target), contents.layout.calibration
    with contextlib.ExitStack() as drafts:
        if suffix == ".csv" and calibration:  # its draft has found room when the table comes
            beside_it = calibration_of(target)
            file = drafts.enter_context(written(beside_it, error=RecordingError, force=force))
            with sentences(beside_it, RecordingError):
                file.write(calibration.encode("utf-8"))
                file.flush()
                os.fsync(file.fileno())
        with written(target, error=RecordingError, force=force) as file:
            WRITERS[suffix](file, contents)


def calibration_of(table: Path) -> Path:
    """Return the file with the calibration of the array whose frames a CSV file holds."""
    return beside(table.with_suffix(""), ".calibration.toml")
