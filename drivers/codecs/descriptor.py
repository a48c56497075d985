"""The descriptor: a small TOML file that says how an array writes its scans, in binary or text."""

import binascii
import math
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal, cast

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.drivers.codecs.stream import (
    MORE,
    Found,
    Scan,
    Skip,
    numbers_or_none,
    overtaken,
    to_marker,
    within,
)
from cnnum.drivers.geometry import Positions, Reading, checked_positions
from cnnum.drivers.options import read_options_file, require, require_limits
from cnnum.errors import CodecError
from cnnum.frame import Limits, limits_of
from cnnum.recordings.recording import channel_names

Check = tuple[int, Callable[[bytes], int]]
"""Bytes of a check, and its value over the bytes before it."""


def crc16_modbus(data: bytes) -> int:
    """Return the CRC-16/MODBUS: 0x8005 reflected, start 0xFFFF; 0x4B37 of ``123456789``."""
    rest = 0xFFFF
    for byte in data:
        rest ^= byte
        for _ in range(8):
            rest = rest >> 1 ^ 0xA001 if rest & 1 else rest >> 1
    return rest


def crc8(data: bytes) -> int:
    """Return the CRC-8/SMBUS: polynomial 0x07, start 0; 0xF4 of ``123456789``."""
    rest = 0
    for byte in data:
        rest ^= byte
        for _ in range(8):
            rest = (rest << 1 ^ 0x07 if rest & 0x80 else rest << 1) & 0xFF
    return rest


def xor8(data: bytes) -> int:
    """Return the exclusive-or of all bytes."""
    rest = 0
    for byte in data:
        rest ^= byte
    return rest


CHECKS: Mapping[str, Check] = {
    "sum8": (1, lambda data: sum(data) & 0xFF),
    "sum16": (2, lambda data: sum(data) & 0xFFFF),
    "lrc8": (1, lambda data: -sum(data) & 0xFF),
    "xor8": (1, xor8),
    "crc8": (1, crc8),
    "crc16-modbus": (2, crc16_modbus),
    "crc16-ccitt": (2, lambda data: binascii.crc_hqx(data, 0xFFFF)),
    "crc32": (4, zlib.crc32),
}
"""By name; `lrc8` makes the sum of all bytes 0."""


CELLS = ("u8", "i8", "u16", "i16", "u32", "i32", "f32", "text")
MOST_BYTES = 1 << 20
"""Largest number of bytes in a packet."""


@dataclass(frozen=True, slots=True)
class Descriptor:
    """Format in which one kind of array writes a scan: ``header counter time cells check tail``.

    Attributes
    ----------
    name : str
    shape : (rows, cols)
        Default shape, which the user can override.
    channels : tuple of str
        Numbers of a taxel, in order: "x", "y" and "z" are the shears and the normal load, and a
        minus reverses the sign, as in "-x".
    order, flip : str, tuple of str
        Order of the numbers if it is not the usual one (`cnnum.drivers.geometry.Reading`).
    planes : bool
        Whether the numbers are grouped by channel instead of by taxel.
    header, tail : str
        Bytes in hexadecimal; empty if there are none.
    cell : str
        One of `CELLS`. With "text", each row of the array is a line of numbers, and an empty line
        ends the scan. An array of one row has one line per scan.
    byte_order : "little" or "big"
        Byte order of cells, counter, time and check.
    counter, time : str
        Types of the number of the scan and of its time; "none" if they are not sent.
    time_unit : "us" or "ms"
    check : str
        Name of a check in `CHECKS`, or "none".
    check_header : bool
        Whether the check includes the header.
    unused : int
        Number of unused bytes after the cells.
    request : str
        Bytes in hexadecimal that request one scan; empty if the array sends by itself.
    scale : float
        Factor on the raw numbers.
    unit : str
    limits : (low, high), or one pair per channel, optional
        Limits of raw numbers. Without a check, a number outside them shows that the bytes are not
        a packet; in a packet with a check, it shows that the taxel has dropped out.
    full : float, optional
        Raw number from which a cell is at the end of its range.
    rate : float
        Scan rate in Hz; 0 if it is not known.
    baud : int
    positions : sequence of (x, y)
        Positions of the taxels, mm, row by row, if they are not on a square grid
        (`cnnum.drivers.geometry`).
    """

    RENAMED: ClassVar = {"axes": "channels"}

    name: str
    shape: tuple[int, int]
    channels: tuple[str, ...] = ("z",)
    planes: bool = False
    header: str = ""
    tail: str = ""
    cell: Literal["u8", "i8", "u16", "i16", "u32", "i32", "f32", "text"] = "u8"
    byte_order: Literal["little", "big"] = "little"
    counter: Literal["none", "u8", "u16", "u32"] = "none"
    time: Literal["none", "u16", "u32"] = "none"
    time_unit: Literal["us", "ms"] = "us"
    check: str = "none"
    check_header: bool = True
    unused: int = 0
    request: str = ""
    scale: float = 1.0
    unit: str = "count"
    limits: Limits | None = None
    full: float | None = None
    rate: float = 0.0
    baud: int = 115_200
    positions: Positions = ()
    order: str = ""
    flip: tuple[Literal["rows", "cols"], ...] = ()

    def __post_init__(self) -> None:
        rows, cols = self.shape
        require("shape", min(rows, cols) >= 1, "rows and columns from 1 up", list(self.shape))
        for key in ("header", "tail", "request"):
            require(key, _is_hex(getattr(self, key)), "bytes in hexadecimal", getattr(self, key))
        require("check", self.check in ("none", *CHECKS), f"'none' or one of {', '.join(CHECKS)}",
                self.check)  # fmt: skip
        require("unused", 0 <= self.unused < MOST_BYTES, "a number of bytes", self.unused)
        holds = math.isfinite(self.scale) and self.scale != 0.0
        require("scale", holds, "a number other than 0", self.scale)
        require("baud", 0 < self.baud <= 10**8, "bits a second, 1 to 100000000", self.baud)
        require("rate", 0.0 <= self.rate < 1e6, "Hz, below 1e6, or 0", self.rate)
        require_limits(self.limits, len(self.channels))
        if self.positions:
            checked_positions(self.positions, rows * cols)
        framed = bool(self.header or self.tail or self.request) or self.cell == "text"
        require("header", framed, "given, or 'tail' or 'request': else no packet can be found", "")
        holds = rows * cols * len(self.channels) <= MOST_BYTES // 8
        require("shape", holds, f"{MOST_BYTES // 8} numbers at most", list(self.shape))
        _ = self.reading

    def at_end(self, raw: Floats) -> NDArray[np.bool_] | None:
        """Return the cells of raw numbers, (rows, cols, channels), at the end of the range."""
        if self.full is None or not (raw >= self.full).any():
            return None
        return np.asarray((raw >= self.full).any(axis=-1))

    @property
    def reading(self) -> Reading:
        """Order and signs of the numbers."""
        return Reading(self.channels, self.order, self.flip)

    @property
    def sound(self) -> Limits | None:
        """Limits of the values of working taxels, if the packets are not judged by them."""
        if self.limits is None or self.check == "none":
            return None
        low, high = self.scale * limits_of(self.limits, len(self.channels))
        ends = zip(np.minimum(low, high).tolist(), np.maximum(low, high).tolist(), strict=True)
        return tuple(ends)

    @property
    def names(self) -> tuple[str, ...]:
        """The full names of the channels, as frames have them."""
        return channel_names(self.reading.plain, len(self.channels))

    @property
    def whole(self) -> tuple[int, int, int]:
        """Rows, columns and channels."""
        return (*self.shape, len(self.channels))

    def raw(self, values: NDArray[np.generic]) -> Floats:
        """Return the raw numbers of a packet for the values of a scan.

        Raises
        ------
        CodecError
            If the scan has another shape.
        """
        if values.shape != self.whole:
            raise CodecError(
                f"The protocol '{self.name}' carries {self.whole} numbers, got {values.shape}."
            )
        return np.asarray(values, np.float64) / self.scale

    @property
    def dtype(self) -> np.dtype[np.generic]:
        """Type of a cell; for text, the type of its numbers."""
        kind = "f8" if self.cell == "text" else f"{self.cell[0]}{int(self.cell[1:]) // 8}"
        return np.dtype(("<" if self.byte_order == "little" else ">") + kind)


def _is_hex(text: str) -> bool:
    try:
        bytes.fromhex(text)
    except ValueError:
        return False
    return True


def bytes_of(kind: str) -> int:
    """Return the number of bytes of a type such as "u16"; 0 for "none"."""
    return 0 if kind == "none" else int(kind[1:]) // 8


def read_descriptor(path: Path, shape: Shape | None = None) -> Descriptor:
    """Read a descriptor.

    Parameters
    ----------
    path : Path
    shape : (rows, cols), optional
        Shape to use instead of the one in the file.

    Raises
    ------
    SceneError
        If the file cannot be read, is not TOML, or a key is unknown, missing or wrong.
    """
    known = read_options_file(Descriptor, "The descriptor", path, {})
    if shape is None or shape == known.shape:
        return known
    same = shape[0] * shape[1] == known.shape[0] * known.shape[1]
    changes = {"shape": list(shape), **({} if same else {"positions": []})}
    return read_options_file(Descriptor, "The descriptor", path, changes)


FAULTY = 3
"""Consecutive packets with the same fault before it is reported, as one may arise by chance."""

MICROS = {"us": 1, "ms": 1000}


class FixedSize:
    """The format of a descriptor whose cells are binary.

    A packet with a check is accepted if the check is right. One without is accepted if the header
    of the next packet is at its expected place, or if its own tail and that of the previous or the
    next packet are; otherwise only if its numbers continue the previous ones. If a check of one
    byte, or none, leaves several overlapping candidates, further packets decide.

    Attributes
    ----------
    size : int
        Number of bytes of a packet.
    trouble : str
        What is wrong with packets that are complete except for their numbers; "" if nothing is.
    """

    def __init__(self, descriptor: Descriptor) -> None:
        d = self._descriptor = descriptor
        self.trouble, self._faulty = "", 0
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
            self._faulty += 1
            if self._faulty >= FAULTY:
                self.trouble = self._fault(packet)
            return Skip(1, bad=True)
        seen = self._believed(data, locked=locked, ended=ended)
        if not isinstance(seen, Found):
            return seen
        self.trouble, self._faulty = "", 0
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

    def _fault(self, packet: bytes) -> str:
        """Return a sentence on the numbers of a packet that has its header and its tail."""
        rows, cols, _ = self._descriptor.whole
        lost = int((~np.isfinite(self._numbers(packet))).any(axis=2).sum())
        if not lost:
            return "Packets have the form of the protocol, but numbers beyond its limits."
        return (
            f"Packets have the form of the protocol, but {lost} of their {rows * cols} taxels send "
            "NaN or infinity: check these chips and their wiring."
        )

    def _values(self, packet: bytes) -> Floats | None:
        """Return the raw numbers, or None where they are out of range."""
        d, raw = self._descriptor, self._numbers(packet)
        # a check believes the packet: a number outside is then a taxel's fault
        inside = d.check != "none" or within(raw, d.limits)
        return raw if inside and numbers_or_none(raw) else None

    def _numbers(self, packet: bytes) -> Floats:
        d = self._descriptor
        cells = np.frombuffer(packet, self._dtype, self._count, self._cells)
        with np.errstate(invalid="ignore"):  # damage makes signalling NaNs, too
            raw = cells.astype(np.float64)
        rows, cols, axes = d.whole
        if d.planes:
            raw = raw.reshape(axes, rows, cols).transpose(1, 2, 0)
        return raw.reshape(rows, cols, axes)

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
        """Return the packet of a scan; integer cells are rounded and clipped to their range.

        Errors are those of `Descriptor.raw`.
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


DIGITS = 32
"""Number of characters of the longest number."""

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
        """Return the lines of a scan; errors are those of `Descriptor.raw`."""
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
