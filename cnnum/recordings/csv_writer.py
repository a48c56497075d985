"""Recordings as CSV, for other programs: a row a frame."""

import csv
import io
from collections.abc import Iterator
from typing import IO

import numpy as np

from cnnum.frame import Frame
from cnnum.recordings.layout import Layout
from cnnum.recordings.reader import Contents

MARKS = "saturated"
"""The last column: the taxels at an end of their range, as in "r0_c3 r1_c3"."""


def write_table(file: IO[bytes], contents: Contents) -> None:
    """Write sequence, time, flags, then every cell's channels, the ground truth, and marks.

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
    ]


def _rows(contents: Contents) -> Iterator[list[object]]:
    for frame, _ in contents.stored():
        yield [frame.sequence, repr(frame.time), int(frame.quality), *_cells(frame)]


def _cells(frame: Frame) -> Iterator[object]:
    yield from (repr(value) for value in frame.values.ravel().tolist())
    if frame.truth:
        yield from frame.truth.values.values()
    at_end = [] if frame.saturated is None else np.argwhere(frame.saturated).tolist()
    yield " ".join(f"r{row}_c{col}" for row, col in at_end)
