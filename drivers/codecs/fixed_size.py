"""Packets of one size that a descriptor describes, in binary."""

from typing import cast

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.codecs.checksums import CHECKS
from cnnum.drivers.codecs.descriptor import Descriptor, bytes_of
from cnnum.drivers.codecs.scan import Scan, numbers_or_none, within
from cnnum.drivers.codecs.stream import MORE, Found, Skip, overtaken, to_marker

MICROS = {"us": 1, "ms": 1000}


class FixedSize:
    """The format of a descriptor whose cells are binary.

    A packet with a check is believed by its check. One without is believed if the next packet's
    header stands where it must, or if its own tail and that of the packet before or after do;
    otherwise only where its numbers go on from those before. Where a check of one byte, or none,
    leaves a choice among beginnings that overlap, more packets decide.

    Attributes
    ----------
    size : int
        Bytes of a packet.
    """

    def __init__(self, descriptor: Descriptor) -> None:
        d = self._descriptor = descriptor
        self._header, self._tail = bytes.fromhex(d.header), bytes.fromhex(d.tail)
        self._counter = len(self._header)
        self._time = self._counter + bytes_of(d.counter)
        self._cells = self._time + bytes_of(d.time)
        self._dtype, self._count, self._channels = d.dtype, int(np.prod(d.whole)), d.names
        self._check = self._cells + self._count * self._dtype.itemsize + d.unused
        width = CHECKS[d.check][0] if d.check != "none" else 0
        self._end = self._check + width
        self.size = self._end + len(self._tail)

    def look(self, data: bytearray, *, locked: bool, ended: bool) -> Found | Skip | None:
        """Return the scan, gap or wait at the front of `data`."""
        if self._header:
            before = to_marker(data, self._header, ended=ended)
            if before is not None:
                return before
        if len(data) < self.size:
            return Skip(1) if ended else MORE
        if not (self._header or self._tail) and len(data) > self.size:
            return Skip(len(data), bad=True)  # an answer has its size, or it is none
        packet = bytes(data[: self.size])
        if packet[self._end :] != self._tail:
            return self._to_tail(data, locked=locked)
        if not self._checked(packet):
            return Skip(1, bad=True)
        values = self._values(packet)
        if values is None:
            return Skip(1, bad=True)
        seen = self._believed(data, locked=locked, ended=ended)
        if not isinstance(seen, Found):
            return seen
        return Found(self.size, self._scan(packet, values), seen.alone)

    def _to_tail(self, data: bytearray, *, locked: bool) -> Skip:
        """Return the bytes before the next place of which the tail stands where it must."""
        if self._header:
            return Skip(1, bad=locked)
        at = data.find(self._tail, self._end)
        return Skip(at - self._end if at > 0 else len(data) - self.size + 1)

    def _checked(self, packet: bytes) -> bool:
        d = self._descriptor
        if d.check == "none":
            return True
        covered = packet[0 if d.check_header else len(self._header) : self._check]
        expected = CHECKS[d.check][1](covered)
        return int.from_bytes(packet[self._check : self._end], d.byte_order) == expected

    def _believed(self, data: bytearray, *, locked: bool, ended: bool) -> Found | Skip | None:
        """Return whether the next bytes agree that this was a packet."""
        if self._descriptor.request:
            return Found(self.size)
        if self._descriptor.check == "none":
            followed = self._followed(data, locked=locked, ended=ended)
            if not isinstance(followed, Found) or followed.alone:
                return followed
        if self._end - self._check > 1 or not self._header:
            return Found(self.size)
        return overtaken(data, self.size, self._header, self._whole, ended=ended)

    def _whole(self, packet: bytes) -> bool:
        return packet[self._end :] == self._tail and self._checked(packet)

    def _followed(self, data: bytearray, *, locked: bool, ended: bool) -> Found | None:
        """Return whether the next packet, or its tail, stands where it must."""
        if (self._tail and locked) or (ended and len(data) == self.size):
            return Found(self.size)
        at, marker = self.size, self._header
        if self._tail:
            at, marker = 2 * self.size - len(self._tail), self._tail
        there = bytes(data[at : at + len(marker)])
        if there == marker:
            return Found(self.size)
        if len(there) == len(marker) or not marker.startswith(there) or ended:
            return Found(self.size, alone=True)
        return MORE

    def _values(self, packet: bytes) -> Floats | None:
        """Return the raw numbers, or None where they are out of range."""
        d = self._descriptor
        cells = np.frombuffer(packet, self._dtype, self._count, self._cells)
        with np.errstate(invalid="ignore"):  # damage makes signalling NaNs, too
            raw = cells.astype(np.float64)
        rows, cols, axes = d.whole
        if d.planes:
            raw = raw.reshape(axes, rows, cols).transpose(1, 2, 0)
        raw = raw.reshape(rows, cols, axes)
        # a check believes the packet: a number outside is then a taxel's fault
        inside = d.check != "none" or within(raw, d.limits)
        return raw if inside and numbers_or_none(raw) else None

    def _scan(self, packet: bytes, values: Floats) -> Scan:
        d, order = self._descriptor, self._descriptor.byte_order
        has_counter, has_time = d.counter != "none", d.time != "none"
        time = int.from_bytes(packet[self._time : self._cells], order) * MICROS[d.time_unit]
        at_end = d.at_end(values)
        return Scan(
            values=values * d.scale if d.scale != 1.0 else values,
            saturated=at_end is not None,
            at_end=at_end,
            channels=self._channels,
            unit=d.unit,
            sequence=int.from_bytes(packet[self._counter : self._time], order)
            if has_counter
            else None,
            sequence_wrap=1 << 8 * bytes_of(d.counter),
            time_us=time if has_time else None,
            time_wrap=MICROS[d.time_unit] << 8 * bytes_of(d.time),
            period_us=round(1e6 / d.rate) if d.rate else 0,
        )

    def encode(self, scan: Scan) -> bytes:
        """Return the packet of a scan; whole cells are rounded, and clipped at their range.

        It raises as `Descriptor.raw`.
        """
        d = self._descriptor
        values = d.raw(scan.values)
        values = values.transpose(2, 0, 1) if d.planes else values
        if d.dtype.kind != "f":
            known = np.iinfo(cast("np.dtype[np.int64]", d.dtype))
            values = np.clip(np.rint(values), known.min, known.max)
        data = self._header + _number(scan.sequence, d.counter, d.byte_order)
        data += _number((scan.time_us or 0) // MICROS[d.time_unit], d.time, d.byte_order)
        data += values.astype(d.dtype).tobytes() + bytes(d.unused)
        if d.check != "none":
            width, check = CHECKS[d.check]
            covered = data if d.check_header else data[len(self._header) :]
            data += check(covered).to_bytes(width, d.byte_order)
        return data + self._tail


def _number(value: int | None, kind: str, order: "str") -> bytes:
    width = bytes_of(kind)
    return ((value or 0) % (1 << 8 * width)).to_bytes(width, "big" if order == "big" else "little")
