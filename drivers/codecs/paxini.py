"""PaXini PX-6AX GEN3: three forces per taxel, through its converter or its high-speed board.

Facts of the wire: community drivers; the maker's own document was not seen. A taxel is Fx i8, Fy i8
and Fz u8, 0.1 N each. The last byte of a packet makes the sum of all its bytes 0.
"""

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.drivers.codecs.descriptor import CHECKS
from cnnum.drivers.codecs.stream import MORE, Decoder, Found, Scan, Skip, overtaken, to_marker
from cnnum.drivers.codecs.wire import Asked, Form, Wire, shape_or
from cnnum.errors import CodecError
from cnnum.frame import FORCE_AXES

BAUD = 921_600
NEWTON = 0.1
CELL = np.dtype([("x", "i1"), ("y", "i1"), ("z", "u1")])
DISTRIBUTED = 1038
"""Register of the forces of all taxels."""

ANSWER = struct.Struct("<2sHBBBIHB")
"""marker, length, device, 0, 0xFB, address, bytes, status."""

FINE = (0, 1)
"""Status of an answer; 1 is an error of length that the board puts on good answers too."""

RESULTANT = 6
"""Bytes of a module's resultant force before its taxels."""


def lrc(data: bytes) -> bytes:
    """Return the last byte of a packet."""
    return bytes([CHECKS["lrc8"][1](data)])


def request(device: int, taxels: int) -> bytes:
    """Return the request to a converter for all taxels of a device."""
    data = struct.pack("<2sHBBBIH", b"\x55\xaa", 9, device, 0, 0xFB, DISTRIBUTED, 3 * taxels)
    return data + lrc(data)


def push(on: bool) -> bytes:
    """Return the request to a high-speed board to send by itself, or to stop."""
    data = struct.pack("<2sBBHHB", b"\x55\xaa", 0, 0x10, 0x0017, 1, on)
    return data + lrc(data)


def converter(options: Asked) -> Wire:
    """Return the protocol of the converter, which needs a request for each scan."""
    shape = shape_or(options, (1, 31))
    answers = Converter(shape, options.address)
    return Wire(
        "PaXini's converter",
        BAUD,
        lambda: Decoder(answers),
        answers.encode,
        request=request(options.address, shape[0] * shape[1]),
        form=Form(shape, FORCE_AXES, "N", 0.0, 10.0),
    )


def high_speed_board(options: Asked) -> Wire:
    """Return the protocol of the high-speed board, which sends by itself once told to."""
    board = HighSpeedBoard(shape_or(options, (1, 31)))
    return Wire(
        "PaXini's high-speed board",
        BAUD,
        lambda: Decoder(board),
        board.encode,
        # an unclean exit leaves the board sending, and then it takes no other command
        greeting=push(False) + push(True),
        farewell=push(False),
        form=Form(board.shape, FORCE_AXES, "N", 0.0, 10.0),
    )


def _passes(packet: bytes) -> bool:
    """Return whether a packet of the high-speed board reports no error, and its sum is 0."""
    return not (packet[5] or sum(packet) & 0xFF)


def _cells(data: bytes, shape: Shape) -> NDArray[np.void]:
    cells: NDArray[np.void] = np.frombuffer(data, CELL, shape[0] * shape[1])
    return cells


def _at_an_end(data: bytes, shape: Shape) -> NDArray[np.bool_]:
    """Return the taxels with a force at an end of its byte, (rows, cols)."""
    cells = _cells(data, shape)
    shear = np.stack([cells["x"], cells["y"]])
    ends = ((shear >= 127) | (shear <= -128)).any(axis=0) | (cells["z"] >= 255)
    return np.asarray(ends.reshape(shape))


def _forces(data: bytes, shape: Shape) -> Floats:
    cells = _cells(data, shape)
    return NEWTON * np.stack([cells[axis] for axis in "xyz"], axis=-1).astype(float).reshape(
        *shape, 3
    )


def _bytes(scan: Scan, shape: Shape) -> bytes:
    if scan.values.shape != (*shape, 3):
        raise CodecError(f"The module carries {(*shape, 3)} numbers, got {scan.values.shape}.")
    tenths = np.rint(np.asarray(scan.values, np.float64) / NEWTON).reshape(-1, 3)
    cells = np.empty(len(tenths), CELL)
    cells["x"], cells["y"] = (np.clip(tenths[:, n], -128, 127) for n in (0, 1))
    cells["z"] = np.clip(tenths[:, 2], 0, 255)
    return cells.tobytes()


@dataclass(frozen=True, slots=True)
class Converter:
    """The format of the converter's answers.

    Attributes
    ----------
    shape : (rows, cols)
        Shape of the array of taxels, which the converter does not report.
    device : int
    """

    shape: Shape
    device: int = 1

    @property
    def cells(self) -> int:
        """Bytes of the taxels."""
        return 3 * self.shape[0] * self.shape[1]

    def look(self, data: bytearray, *, locked: bool, ended: bool) -> Found | Skip | None:
        """Return the scan, gap or wait at the front of `data`."""
        before = to_marker(data, b"\xaa\x55", ended=ended)
        if before is not None:
            return before
        if len(data) < ANSWER.size:
            return MORE
        _, length, _, _, function, address, count, status = ANSWER.unpack_from(data)
        size = ANSWER.size + self.cells + 1
        fits = (length, function, address, count) == (size - 5, 0xFB, DISTRIBUTED, self.cells)
        if not fits or status not in FINE:
            return Skip(1)
        if len(data) < size:
            return MORE
        packet = bytes(data[:size])
        if sum(packet) & 0xFF:
            return Skip(1, bad=True)
        return Found(size, self._scan(packet[ANSWER.size : -1]))

    def _scan(self, data: bytes) -> Scan:
        values = _forces(data, self.shape)
        ends = _at_an_end(data, self.shape)
        return Scan(
            values=values, channels=FORCE_AXES, unit="N", saturated=bool(ends.any()), at_end=ends
        )

    def encode(self, scan: Scan) -> bytes:
        """Return the answer that carries a scan.

        Raises
        ------
        CodecError
            If it is not of the module's shape.
        """
        cells = _bytes(scan, self.shape)
        size = ANSWER.size + len(cells) + 1
        head = (b"\xaa\x55", size - 5, self.device, 0, 0xFB, DISTRIBUTED, len(cells), 0)
        data = ANSWER.pack(*head) + cells
        return data + lrc(data)


@dataclass(frozen=True, slots=True)
class HighSpeedBoard:
    """The format of the high-speed board with one module: resultant, then taxels.

    The order of the two follows community drivers; confirm it on your board.

    Attributes
    ----------
    shape : (rows, cols)
        Shape of the module's taxels.
    """

    shape: Shape

    def look(self, data: bytearray, *, locked: bool, ended: bool) -> Found | Skip | None:
        """Return the scan, gap or wait at the front of `data`."""
        before = to_marker(data, b"\xaa\x56", ended=ended)
        if before is not None:
            return before
        if len(data) < 6:
            return MORE
        cells = 3 * self.shape[0] * self.shape[1]
        length = int.from_bytes(data[3:5], "little")
        if length - 1 not in (cells, RESULTANT + cells):
            return Skip(1)
        size = length + 6
        if len(data) < size:
            return MORE
        packet = bytes(data[:size])
        if not _passes(packet):
            return Skip(1, bad=True)
        seen = overtaken(data, size, bytes(data[:5]), _passes, ended=ended)
        if not isinstance(seen, Found):
            return seen
        taxels = packet[-1 - cells : -1]
        values, ends = _forces(taxels, self.shape), _at_an_end(taxels, self.shape)
        extras: dict[str, float] = {}
        if length - 1 > cells:
            low = np.frombuffer(packet[6 : 6 + RESULTANT : 2], CELL, 1)[0]
            extras = {f"device_{axis}": NEWTON * float(low[axis]) for axis in "xyz"}
        return Found(
            size,
            Scan(values, FORCE_AXES, "N", saturated=bool(ends.any()), at_end=ends, extras=extras),
        )

    def encode(self, scan: Scan) -> bytes:
        """Return the packet of a scan.

        Raises
        ------
        CodecError
            If it is not of the module's shape.
        """
        cells = bytes(RESULTANT) + _bytes(scan, self.shape)
        data = b"\xaa\x56\x00" + struct.pack("<HB", len(cells) + 1, 0) + cells
        return data + lrc(data)
