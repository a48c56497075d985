"""The descriptor: a small TOML file that says how an array writes its scans."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.drivers.codecs.checksums import CHECKS
from cnnum.drivers.geometry import Positions, checked_positions
from cnnum.drivers.options import (
    read_options_file,
    require,
    require_limits,
)
from cnnum.drivers.reordered import Reading
from cnnum.errors import CodecError
from cnnum.frame import Limits, limits_of
from cnnum.recordings.recording import channel_names

CELLS = ("u8", "i8", "u16", "i16", "u32", "i32", "f32", "text")
COUNTERS = ("none", "u8", "u16", "u32")
MOST_BYTES = 1 << 20
"""Of a packet."""


@dataclass(frozen=True, slots=True)
class Descriptor:
    """How one kind of array writes a scan: ``header counter time cells check tail``.

    Attributes
    ----------
    name : str
    shape : (rows, cols)
        Unless the user says another.
    channels : tuple of str
        Numbers of a taxel in their order; "x", "y", "z" are the shears and the normal load, and a
        minus turns the sign: "-x".
    order, flip : str, tuple of str
        Of the numbers, where they follow each other otherwise (`cnnum.drivers.reordered.Reading`).
    planes : bool
        Whether all taxels of a channel come together, and not all channels of a taxel.
    header, tail : str
        Bytes in hexadecimal; empty where there are none.
    cell : str
        One of `CELLS`. "text" is numbers in a line: a row of the array is a line, and an empty line
        ends the scan. An array of one row is one line a scan.
    byte_order : "little" or "big"
        Of cells, counter, time and check.
    counter, time : str
        Types of the number of the scan, and of its time; "none" where they are not sent.
    time_unit : "us" or "ms"
    check : str
        Name of a check in `CHECKS`, or "none".
    check_header : bool
        Whether the check goes over the header too.
    unused : int
        Bytes after the cells that mean nothing.
    request : str
        Bytes in hexadecimal that ask for one scan; empty where the array sends by itself.
    scale : float
        The factor of a raw number.
    unit : str
    limits : (low, high), or a pair a channel, optional
        Limits of raw numbers. One outside is a sign that the bytes are no packet, where no check
        says that they are; of a packet with a check the taxel has dropped out.
    full : float, optional
        A raw number at which, and beyond which, a cell is at the end of its range.
    rate : float
        Hz; 0 where it is not known.
    baud : int
    positions : sequence of (x, y)
        Places of the taxels, mm, row by row, where these lie on no square grid
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
        found = bool(self.header or self.tail or self.request) or self.cell == "text"
        require("header", found, "given, or 'tail' or 'request': else no packet can be found", "")
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
        """The limits of the values of sound taxels, where the packets do not go by them."""
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
        """Return the numbers that a packet holds of a scan's values.

        Raises
        ------
        CodecError
            If the scan is not of this shape.
        """
        if values.shape != self.whole:
            raise CodecError(
                f"The protocol '{self.name}' carries {self.whole} numbers, got {values.shape}."
            )
        return np.asarray(values, np.float64) / self.scale

    @property
    def dtype(self) -> np.dtype[np.generic]:
        """Type of a cell; of text, that of its numbers."""
        kind = "f8" if self.cell == "text" else f"{self.cell[0]}{int(self.cell[1:]) // 8}"
        return np.dtype(("<" if self.byte_order == "little" else ">") + kind)


def _is_hex(text: str) -> bool:
    try:
        bytes.fromhex(text)
    except ValueError:
        return False
    return True


def bytes_of(kind: str) -> int:
    """Return the bytes of a number of a type such as "u16"; 0 of "none"."""
    return 0 if kind == "none" else int(kind[1:]) // 8


def read_descriptor(path: Path, shape: Shape | None = None) -> Descriptor:
    """Read a descriptor.

    Parameters
    ----------
    path : Path
    shape : (rows, cols), optional
        Used in place of the file's.

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
