"""Contactile PapillArray, PTS 2: sensors of 3×3 pillars with force, displacement and slip.

Facts of the wire: the public parser and tests of ``contactile_pts_lab``. A frame is a start marker,
data, a u16 sum of the data's bytes, and an end marker. Everything is little-endian.
"""

import struct
from typing import NamedTuple

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.drivers.codecs.stream import MORE, Decoder, Found, Scan, Skip, to_marker
from cnnum.drivers.codecs.wire import Asked, Form, Wire, shape_or
from cnnum.errors import CodecError, SceneError

START, END = bytes.fromhex("55667788"), bytes.fromhex("aabbccdd")
LONGEST = 1 << 15
"""Bytes of the longest frame; one with ten sensors has about 4,300."""

HUB, PILLARS, GLOBAL, PILLAR_SLIP, SENSOR_SLIP = 1, 3, 4, 5, 6
OFFSETS = {1: "B", 2: "H", 4: "I"}
CHANNELS = ("shear_x", "shear_y", "normal", "dx", "dy", "dz")
"""Force in N and displacement in mm."""

RATES = (100, 250, 500, 1000)
SIDE = 3
"""Pillars on a side of a sensor."""


def pts2(options: Asked) -> Wire:
    """Return the protocol; sensors lie side by side, each 3×3.

    Raises
    ------
    SceneError
        If the array does not support the rate.
    """
    if options.rate and options.rate not in RATES:
        raise SceneError(f"'rate' must be one of {RATES} Hz for 'pts2', got {options.rate:g}.")
    greeting = f"f{options.rate:.0f}\n".encode() if options.rate else b""
    settled = b"z\n" if options.bias else b""
    papillarray = Papillarray()
    return Wire(
        "PTS 2",
        115_200,
        lambda: Decoder(papillarray),
        encode,
        greeting=greeting,
        settled=settled,
        form=Form(shape_or(options, (SIDE, SIDE)), CHANNELS, "N", 0.0, 8.0),
    )


class Papillarray:
    """The format. A frame ends at the first end marker for which the checksum is right.

    An end marker may occur within the numbers of a frame, so the next one is tried if the checksum
    is wrong. Later start markers are tried as well, so that a damaged frame does not hide a good
    one.
    """

    def look(self, data: bytearray, *, locked: bool, ended: bool) -> Found | Skip | None:
        """Return the scan, gap or wait at the front of `data`."""
        before = to_marker(data, START, ended=ended)
        if before is not None:
            return before
        end = data.find(END, len(START) + 2)
        while end >= 0:
            begin = self._begin(data, end)
            if begin is not None:
                size = end + len(END) - begin
                if begin:
                    return Skip(begin, bad=True)
                return self._found(bytes(data[len(START) : end - 2]), size)
            end = data.find(END, end + 1, LONGEST)
        if ended or len(data) >= LONGEST:
            return Skip(1, bad=True)
        return MORE

    def _begin(self, data: bytearray, end: int) -> int | None:
        """Return the start of the frame that ends at an end marker, if its sum fits."""
        check = int.from_bytes(data[end - 2 : end], "little")
        begin = 0
        while 0 <= begin <= end - 2 - len(START):
            body = memoryview(data)[begin + len(START) : end - 2]
            good = sum(body) & 0xFFFF == check
            body.release()
            if good:
                return begin
            begin = data.find(START, begin + 1, end - 2)
        return None

    def _found(self, body: bytes, size: int) -> Found | Skip:
        try:
            return Found(size, scan_of(body))
        except (CodecError, struct.error):
            return Skip(1, bad=True)


def scan_of(body: bytes) -> Scan:
    """Return the scan of a frame's data.

    Raises
    ------
    CodecError
        If the frame has no pillars, or they are not 3×3.
    struct.error
        If an offset points outside the frame.
    """
    blocks = _blocks(body)
    if PILLARS not in blocks:
        raise CodecError("A PTS frame needs the block of its pillars.")
    sensors = [_pillars(sensor) for sensor in _items(blocks[PILLARS])]
    if not sensors or len({len(sensor) for sensor in sensors}) != 1:
        raise CodecError("The sensors of a PTS frame need the same number of pillars.")
    rows, cols = side_by_side(len(sensors[0]))
    shaped = [sensor.reshape(rows, cols, len(CHANNELS)) for sensor in sensors]
    counter, micros = struct.unpack_from("<IQ", blocks[HUB].data) if HUB in blocks else (None, None)
    return Scan(
        values=np.concatenate(shaped, axis=1),
        channels=CHANNELS,
        unit="N",
        sequence=counter,
        time_us=micros,
        extras=_extras(blocks),
    )


def side_by_side(pillars: int) -> Shape:
    """Return rows and columns of a sensor: 3×3, or one row of another number of pillars."""
    return (SIDE, SIDE) if pillars == SIDE * SIDE else (1, pillars)


class Block(NamedTuple):
    """Bytes from the beginning of a block on, and the type of the offsets in it."""

    data: bytes
    offset: str


def _blocks(body: bytes) -> dict[int, Block]:
    """Return the blocks by their type; the table of them ends where the first begins."""
    if not body or body[0] not in OFFSETS:
        raise CodecError("A PTS frame must begin with the size of its offsets: 1, 2 or 4.")
    kind_of_offset = OFFSETS[body[0]]
    entry = struct.Struct(f"<H{kind_of_offset}")
    at, first = 1, len(body)
    table: list[tuple[int, int]] = []
    while at + entry.size <= first:
        kind, offset = entry.unpack_from(body, at)
        at += entry.size
        if not at <= offset <= len(body):
            raise CodecError("A block of a PTS frame begins outside the frame.")
        table.append((kind, offset))
        first = min(first, offset)
    return {kind: Block(body[offset:], kind_of_offset) for kind, offset in table}


def _items(block: "Block") -> list["Block"]:
    """Return the parts of a block: a number of them, offsets, then each from its offset on."""
    (count,) = struct.unpack_from("<H", block.data)
    offsets = struct.unpack_from(f"<{count}{block.offset}", block.data, 2)
    if any(offset > len(block.data) for offset in offsets):
        raise CodecError("A part of a PTS block begins outside the block.")
    return [Block(block.data[offset:], block.offset) for offset in offsets]


def _pillars(sensor: Block) -> Floats:
    rows = [struct.unpack_from("<H6f", pillar.data) for pillar in _items(sensor)]
    if any(row[0] != 2 for row in rows):
        raise CodecError("A pillar of a PTS frame must have two vectors: force and displacement.")
    values = np.array([row[1:] for row in rows], dtype=np.float64)
    if not np.isfinite(values).all():
        raise CodecError("A pillar of a PTS frame contains a number that is not finite.")
    return values


def _extras(blocks: dict[int, Block]) -> dict[str, float]:
    """Return the array's own loads and slip, by sensor."""
    result: dict[str, float] = {}
    names = ("fx", "fy", "fz", "tx", "ty", "tz")
    for number, part in enumerate(_items(blocks[GLOBAL]) if GLOBAL in blocks else []):
        _, *loads = struct.unpack_from("<H6f", part.data)
        result |= {f"device_{n}_{number}": v for n, v in zip(names, loads, strict=True)}
    for number, part in enumerate(_items(blocks[SENSOR_SLIP]) if SENSOR_SLIP in blocks else []):
        _, state, friction, grip = struct.unpack_from("<HBff", part.data)
        result |= {
            f"device_slip_{number}": float(state),
            f"device_friction_{number}": friction,
            f"device_grip_{number}": grip,
        }
    slips = blocks.get(PILLAR_SLIP)
    for number, sensor in enumerate(_items(slips) if slips is not None else []):
        states = [struct.unpack_from("<Hbf", pillar.data)[1] for pillar in _items(sensor)]
        result[f"device_slipped_{number}"] = float(sum(state == 3 for state in states))
    return result


def encode(scan: Scan) -> bytes:
    """Return the frame of a scan with its hub and pillar blocks.

    Raises
    ------
    CodecError
        If the scan's rows are not 3, or its columns no multiple of 3 (one row has one sensor).
    """
    rows, cols, axes = scan.values.shape
    whole = rows == 1 or (rows == SIDE and cols % SIDE == 0)
    if not whole or axes > len(CHANNELS):
        raise CodecError(
            f"PTS 2 carries sensors of 3×3 pillars, or one row of them, with at most "
            f"{len(CHANNELS)} numbers each, got {scan.values.shape}."
        )
    values = np.zeros((rows, cols, len(CHANNELS)))
    values[..., :axes] = scan.values
    width = cols if rows == 1 else SIDE
    sensors = [
        _part_list([struct.pack("<H6f", 2, *p) for p in values[:, at : at + width].reshape(-1, 6)])
        for at in range(0, cols, width)
    ]
    hub = struct.pack("<IQ", (scan.sequence or 0) % 2**32, scan.time_us or 0)
    begin = 1 + 2 * 4
    table = struct.pack("<HHHH", HUB, begin, PILLARS, begin + len(hub))
    body = b"\2" + table + hub + _part_list(sensors)
    return START + body + struct.pack("<H", sum(body) & 0xFFFF) + END


def _part_list(parts: list[bytes]) -> bytes:
    offsets = [2 + 2 * len(parts) + sum(map(len, parts[:n])) for n in range(len(parts))]
    return struct.pack(f"<H{len(parts)}H", len(parts), *offsets) + b"".join(parts)
