"""Recordings as CSV, for other programs: a row a frame."""

import csv
import io
from collections.abc import Iterator
from typing import IO

import numpy as np
from numpy.typing import NDArray

from cnnum.frame import Frame
from cnnum.recordings.layout import Layout
from cnnum.recordings.reader import Contents

MARKS = "saturated"
"""A column: the taxels at an end of their range, as in "r0_c3 r1_c3"."""

CAME, RATE = "log time (ns)", "rate (Hz)"
"""The last columns: when a frame came, by the time of day; and the rate, the same in all rows."""


def write_table(file: IO[bytes], contents: Contents) -> None:
    """Write sequence, time, flags, then every cell's channels, the ground truth, marks and more.

    Numbers stand in the shortest form that is read back as the same.

    It raises as `cnnum.recordings.mcap_writer.write_mcap`.
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
        MARKS,
        CAME,
        RATE,
    ]


def _rows(contents: Contents) -> Iterator[list[object]]:
    rate = repr(contents.layout.rate)
    for frame, came in contents.stored():
        head = [frame.sequence, repr(frame.time), int(frame.quality)]
        yield [*head, *_cells(frame), came, rate]


def marked_text(marks: NDArray[np.bool_] | None) -> str:
    """Return the names of the taxels at an end of their range."""
    at_end = [] if marks is None else np.argwhere(marks).tolist()
    return " ".join(f"r{row}_c{col}" for row, col in at_end)


def _cells(frame: Frame) -> Iterator[object]:
    yield from (repr(value) for value in frame.values.ravel().tolist())
    if frame.truth:
        yield from frame.truth.values.values()
    yield marked_text(frame.saturated)
