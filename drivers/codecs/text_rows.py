"""Scans as lines of text: numbers with spaces or commas between them."""

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.codecs.descriptor import Descriptor
from cnnum.drivers.codecs.scan import Scan, numbers_or_none, within
from cnnum.drivers.codecs.stream import MORE, Found, Skip

DIGITS = 32
"""Signs of the longest number."""

ALLOWED = b"0123456789+-.eE ,;\t\r\nNnAa"
BLANKS = bytes.maketrans(b",;", b"  ")


class TextRows:
    """The format of a descriptor whose cells are text."""

    def __init__(self, descriptor: Descriptor) -> None:
        self._descriptor = descriptor
        rows, cols, axes = descriptor.whole
        self._rows, self._numbers = rows, cols * axes
        self._channels = descriptor.names
        self._longest = rows * (self._numbers * DIGITS + 2) + 2

    def look(self, data: bytearray, *, locked: bool, ended: bool) -> Found | Skip | None:
        """Return the scan, gap or wait at the front of `data`."""
        end = self._end_of_scan(data)
        if end < 0:
            return Skip(1) if ended or len(data) > self._longest else MORE
        lines = bytes(data[:end]).splitlines(keepends=True)
        full = [line for line in lines if line.strip()]
        if not full:
            return Found(end)  # an empty line more
        before = b"".join(lines[: max(0, _index(lines, full, self._rows))])
        values = self._values(full[-self._rows :])
        if values is None:
            first = len(lines[0])
            return Skip(first if len(full) > self._rows else end, bad=True)
        if before.strip():
            return Skip(len(before))
        d = self._descriptor
        at_end = d.at_end(values)
        return Found(
            end,
            Scan(
                values * d.scale if d.scale != 1.0 else values,
                self._channels,
                d.unit,
                period_us=round(1e6 / d.rate) if d.rate else 0,
                saturated=at_end is not None,
                at_end=at_end,
            ),
        )

    def _end_of_scan(self, data: bytearray) -> int:
        if self._rows == 1:
            return data.find(b"\n") + 1 or -1
        ends = [at + len(mark) for mark in (b"\n\n", b"\n\r\n") if (at := data.find(mark)) >= 0]
        return min(ends, default=-1)

    def _values(self, lines: list[bytes]) -> Floats | None:
        if len(lines) != self._rows:
            return None
        rows = [_floats(line) for line in lines]
        if any(len(row) != self._numbers for row in rows):
            return None
        values = np.array(rows).reshape(self._descriptor.whole)
        inside = numbers_or_none(values) and within(values, self._descriptor.limits)
        return values if inside else None

    def encode(self, scan: Scan) -> bytes:
        """Return the lines of a scan; it raises as `Descriptor.raw`."""
        raw = self._descriptor.raw(scan.values)
        lines = [" ".join(f"{v:.9g}" for v in row.ravel().tolist()) for row in raw]
        return ("\n".join(lines) + ("\n" if self._rows == 1 else "\n\n")).encode()


def _index(lines: list[bytes], full: list[bytes], rows: int) -> int:
    """Return the line that the last `rows` full ones begin at."""
    if len(full) <= rows:
        return 0
    begin, seen = len(lines), 0
    while seen < rows:
        begin -= 1
        seen += bool(lines[begin].strip())
    return begin


def _floats(line: bytes) -> list[float]:
    """Return the numbers of a line; none where one is not a number."""
    if line.translate(None, ALLOWED):
        return []
    try:
        return list(map(float, line.translate(BLANKS).split()))
    except ValueError:
        return []
