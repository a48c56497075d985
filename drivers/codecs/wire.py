"""Protocols by name: the packets of an array, the requests to it, and its baud rate."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module, resources
from pathlib import Path
from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.drivers.codecs.stream import Scan
from cnnum.drivers.geometry import Positions, Reading
from cnnum.drivers.serial_packet import (
    CELL_TYPES,
    LAYOUTS,
    SATURATED,
    SEQUENCE_WRAP,
    UNITS,
    Geometry,
    Packet,
    StreamDecoder,
    encode,
)
from cnnum.errors import CodecError, SceneError, name_error
from cnnum.frame import Limits

ROOM = "cnnum.drivers.codecs"

PROTOCOLS: Mapping[str, str] = {
    "open": f"{ROOM}.wire:open_protocol",
    "pts2": f"{ROOM}.contactile:pts2",
    "xela": f"{ROOM}.xela:xela",
    "paxini": f"{ROOM}.paxini:converter",
    "paxini-board": f"{ROOM}.paxini:high_speed_board",
    "robotiq-tsf85": f"{ROOM}.robotiq:tsf85",
}
"""Functions that make the `Wire` of a protocol, by name; descriptors are not included."""


class Decoding(Protocol):
    """Splits a stream into scans; see `cnnum.drivers.codecs.stream.Decoder`."""

    @property
    def good(self) -> int: ...  # noqa: D102
    @property
    def bad(self) -> int: ...  # noqa: D102
    @property
    def discarded(self) -> int: ...  # noqa: D102
    @property
    def resyncs(self) -> int: ...  # noqa: D102
    @property
    def conflict(self) -> str: ...  # noqa: D102
    def feed(self, chunk: bytes) -> list[Scan]: ...  # noqa: D102
    def flush(self, *, lost: bool = True) -> list[Scan]: ...  # noqa: D102


FULL = {
    "u8": 200.0,
    "i8": 100.0,
    "text": 200.0,
    "f32": 500.0,
    **dict.fromkeys(("u16", "i16", "u32", "i32"), 4000.0),
}
"""Raw number of a strong load, by the type of a cell in a descriptor."""


@dataclass(frozen=True, slots=True)
class Asked:
    """Properties of an array that the user states because its protocol does not.

    Attributes
    ----------
    shape : (rows, cols), optional
    rate : float
        Scan rate to request from the array, Hz; 0 leaves it unchanged.
    address : int
        Address of the device on its bus.
    bias : bool
        Whether to make the array zero itself once it has run for a second.
    """

    shape: Shape | None = None
    rate: float = 0.0
    address: int = 1
    bias: bool = False


@dataclass(frozen=True, slots=True)
class Form:
    """Form of the scans that `Wire.encode` takes.

    Attributes
    ----------
    shape : (rows, cols)
    channels : tuple of str
    unit : str
    rest, full : float
        Numbers of a cell at rest and under a strong load, as an array would send them.
    """

    shape: Shape
    channels: tuple[str, ...]
    unit: str
    rest: float
    full: float


@dataclass(frozen=True, slots=True)
class Wire:
    """A protocol that is ready for use.

    Attributes
    ----------
    name : str
        Name of the protocol in messages.
    baud : int
    decoder : callable
        Returns a new decoder.
    encode : callable
        Converts a scan to the bytes that the array would send.
    greeting : bytes
        Written whenever the port has been opened.
    settled : bytes
        Written once the array has then run for a second.
    request : bytes
        Written for every scan; empty if the array sends by itself.
    farewell : bytes
        Written before the port is closed.
    form : Form or None
        Form of the scans that `encode` takes; None if it takes any scan.
    positions : sequence of (x, y), mm
        Positions of the taxels, if they are not on a square grid.
    limits : (low, high), or one pair per channel, or None
        Limits of the values of a working taxel.
    reading : Reading or None
        Order, signs and units of the numbers of a scan, if they are not as usual.
    verified : bool
        Whether packets carry a checksum. Without one, scans are compared with their neighbours:
        damage that causes no jump is not detected, and a jump of one scan is taken for damage.
    """

    name: str
    baud: int
    decoder: Callable[[], Decoding]
    encode: Callable[[Scan], bytes]
    greeting: bytes = b""
    settled: bytes = b""
    request: bytes = b""
    farewell: bytes = b""
    form: Form | None = None
    verified: bool = True
    positions: Positions = ()
    limits: Limits | None = None
    reading: Reading | None = None


def protocol_names() -> tuple[str, ...]:
    """Return the names of the protocols, those of descriptors last."""
    return (*PROTOCOLS, *sorted(_described()))


def wire(name: str, options: Asked | None = None) -> Wire:
    """Return a protocol by its name.

    Raises
    ------
    UnknownNameError
        If there is no protocol of that name.
    SceneError
        If the protocol does not allow what is requested.
    """
    known = options or Asked()
    if name in PROTOCOLS:
        module, maker = PROTOCOLS[name].split(":")
        return cast(Callable[[Asked], Wire], getattr(import_module(module), maker))(known)
    described = _described()
    if name not in described:
        raise name_error("protocol", name, protocol_names())
    return described_wire(described[name], known)


def _described() -> dict[str, Path]:
    folder = resources.files(ROOM) / "protocols"
    paths = (cast(Path, item) for item in folder.iterdir())
    return {path.name.removesuffix(".toml"): path for path in paths if path.name.endswith(".toml")}


def described_wire(path: Path, options: Asked) -> Wire:
    """Return the protocol that a descriptor describes.

    Raises
    ------
    SceneError
        If the descriptor is wrong.
    """
    from cnnum.drivers.codecs.descriptor import FixedSize, TextRows, read_descriptor
    from cnnum.drivers.codecs.stream import Decoder, Neighbours

    known = read_descriptor(path, options.shape)
    form = TextRows(known) if known.cell == "text" else FixedSize(known)
    reading, signed = known.reading, known.reading.plain != known.channels
    full, verified = FULL[known.cell] * known.scale, known.check != "none"
    return Wire(
        f"'{known.name}'",
        known.baud,
        lambda: Decoder(form, None if verified else Neighbours(full)),
        form.encode,
        request=bytes.fromhex(known.request),
        form=Form(known.shape, known.names, known.unit, 0.0, full),
        verified=verified,
        positions=known.positions,
        limits=known.sound,
        reading=reading if reading.order or reading.flip or signed else None,
    )


def shape_or(options: Asked, usual: Shape) -> Shape:
    """Return the shape that the user gives, or the usual one.

    Raises
    ------
    SceneError
        If it is not a shape.
    """
    shape = options.shape or usual
    if min(shape) < 1 or shape[0] * shape[1] > 1 << 16:
        raise SceneError(
            f"'shape' must be a positive number of rows and columns, got {list(shape)}."
        )
    return shape


def open_protocol(options: Asked) -> Wire:
    """Return the open protocol, whose packets describe the array completely."""
    return Wire("the open protocol", 921_600, OpenDecoder, encode_scan)


def scan_of(packet: Packet) -> Scan:
    """Return a packet's scan."""
    return Scan(
        values=packet.values,
        channels=packet.geometry.names,
        unit=UNITS[packet.geometry.unit],
        sequence=packet.sequence,
        sequence_wrap=SEQUENCE_WRAP,
        time_us=packet.time_us,
        period_us=packet.period_us,
        saturated=bool(packet.flags & SATURATED),
    )


class OpenDecoder:
    """Decoder of the open protocol; its counts are those of `StreamDecoder`."""

    def __init__(self) -> None:
        self._stream = StreamDecoder()

    @property
    def good(self) -> int:
        """Packets that passed their checks."""
        return self._stream.good

    @property
    def bad(self) -> int:
        """Packets with a good header whose CRC-32 failed."""
        return self._stream.bad

    @property
    def discarded(self) -> int:
        """Bytes that belonged to no good packet."""
        return self._stream.discarded

    @property
    def resyncs(self) -> int:
        """Times in which bytes had to be discarded before a packet was found again."""
        return self._stream.resyncs

    @property
    def conflict(self) -> str:
        """Describe the other array that answers, or an empty string if none does."""
        mine, other = self._stream.geometry, self._stream.stranger
        if mine is None or other is None:
            return ""
        return f"{_in_words(other)} in place of {_in_words(mine)}"

    def feed(self, chunk: bytes) -> list[Scan]:
        """Return the scans that `chunk` completes."""
        return [scan_of(packet) for packet in self._stream.feed(chunk)]

    def flush(self, *, lost: bool = True) -> list[Scan]:
        """Return the whole scans in the waiting bytes; each is good by its checks, lost or not."""
        return [scan_of(packet) for packet in self._stream.flush()]


def _in_words(geometry: Geometry) -> str:
    names, unit = ", ".join(geometry.names), UNITS[geometry.unit]
    return f"{geometry.rows}×{geometry.cols} taxels of {names} in {unit} ({geometry.dtype})"


def geometry_of(scan: Scan, cell: str = "<f4") -> Geometry:
    """Return the geometry in which a scan is sent.

    Raises
    ------
    CodecError
        If the protocol has no code for the scan's unit or for the cell type.
    """
    units = {name: code for code, name in UNITS.items()}
    cells = {name: code for code, name in CELL_TYPES.items()}
    layouts = {names: code for code, names in LAYOUTS.items()}
    if scan.unit not in units or cell not in cells:
        raise CodecError(
            f"The protocol carries the units {', '.join(units)} in the cell types "
            f"{', '.join(cells)}, got '{scan.unit}' in '{cell}'."
        )
    rows, cols, channels = scan.values.shape
    layout = layouts.get(scan.channels, 0)
    return Geometry(rows, cols, channels, cells[cell], layout, units[scan.unit])


def encode_scan(scan: Scan, cell: str = "<f4") -> bytes:
    """Return the packet of a scan; integer cells are rounded and clipped to their range.

    Raises
    ------
    CodecError
        If the protocol cannot transmit the scan.
    """
    geometry = geometry_of(scan, cell)
    packet = Packet(
        geometry=geometry,
        values=_cells(np.asarray(scan.values, np.float64), geometry.dtype),
        sequence=(scan.sequence or 0) % SEQUENCE_WRAP,
        time_us=scan.time_us or 0,
        period_us=scan.period_us,
        flags=SATURATED if scan.saturated else 0,
    )
    return encode(packet)


def _cells(values: Floats, dtype: np.dtype[np.generic]) -> NDArray[np.generic]:
    if dtype.kind == "f":
        return values.astype(dtype)
    bits = 8 * dtype.itemsize
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if dtype.kind == "i" else (0, 2**bits - 1)
    return np.clip(np.rint(values), low, high).astype(dtype)
