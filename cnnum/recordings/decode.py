"""From the records of a chunk back to frames, all of a chunk at once."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from cnnum.errors import CodecError
from cnnum.frame import Frame, Quality, Truth
from cnnum.recordings.chunks import ENCODING, SCHEMA, untimed
from cnnum.recordings.layout import Layout
from cnnum.recordings.mcap_records import PREFIX, RECORD, Budget, Fields, records_in
from cnnum.recordings.raw_chunks import is_raw

INSIDE = RECORD // 4
"""Bytes that are read and summed in the time that one record of an unpacked chunk takes."""

NO_FRAMES = np.dtype([("sequence", np.int64)])
"""Of a chunk of raw bytes."""


@dataclass(frozen=True, slots=True)
class Topic:
    """A channel of a file whose messages are frames."""

    channel: int
    layout: Layout


class Decoder:
    """Reads one chunk after the other; the layout of the first holds for all.

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
            raise CodecError("it holds the frames of two arrays.")
        self._topic = met

    def _is_ours(self, message: bytes) -> bool:
        number = int.from_bytes(message[PREFIX.size : PREFIX.size + 2], "little")
        return self._topic is not None and number == self._topic.channel


def _rows(data: bytes, count: int, layout: Layout) -> NDArray[np.void]:
    form = layout.message
    if len(data) != count * form.itemsize:
        raise CodecError("a message of it has not the length of a frame.")
    rows: Any = np.frombuffer(data, form)
    if not _fit(rows, layout):
        raise CodecError("a message of it is no frame of its array.")
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
