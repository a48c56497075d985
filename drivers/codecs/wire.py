"""The protocols by name: an array's packets, the requests to it, and the speed of its line."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module, resources
from pathlib import Path
from typing import Protocol, cast

from cnnum.arrays import Shape
from cnnum.drivers.codecs.scan import Scan
from cnnum.drivers.geometry import Positions
from cnnum.drivers.reordered import Reading
from cnnum.errors import SceneError, name_error
from cnnum.frame import Limits

ROOM = "cnnum.drivers.codecs"

PROTOCOLS: Mapping[str, str] = {
    "open": f"{ROOM}.open_protocol:open_protocol",
    "pts2": f"{ROOM}.contactile:pts2",
    "xela": f"{ROOM}.xela:xela",
    "paxini": f"{ROOM}.paxini:converter",
    "paxini-board": f"{ROOM}.paxini:high_speed_board",
    "robotiq-tsf85": f"{ROOM}.robotiq:tsf85",
}
"""Name to the function that makes its `Wire`; those of descriptors are apart."""


class Decoding(Protocol):
    """Cuts a stream into scans: `cnnum.drivers.codecs.stream.Decoder` explains each."""

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
"""A strong load in the numbers of a cell, by its type in a descriptor."""


@dataclass(frozen=True, slots=True)
class Asked:
    """The user's facts of an array that its protocol lacks.

    Attributes
    ----------
    shape : (rows, cols), optional
    rate : float
        Hz that the array is asked for; 0 leaves it as it is.
    address : int
        Address of the device on its bus.
    bias : bool
        Whether the array is asked to zero itself once it has run for a second.
    """

    shape: Shape | None = None
    rate: float = 0.0
    address: int = 1
    bias: bool = False


@dataclass(frozen=True, slots=True)
class Form:
    """The scans that `Wire.encode` takes.

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
    """A protocol, ready to be spoken.

    Attributes
    ----------
    name : str
        As a sentence names it.
    baud : int
    decoder : callable
        Returns a new decoder.
    encode : callable
        From a scan to the bytes that the array would send.
    greeting : bytes
        Written whenever the port has been opened.
    settled : bytes
        Written when the array has run for a second after that.
    request : bytes
        Written for every scan; empty where the array sends by itself.
    farewell : bytes
        Written before the port is closed.
    form : Form or None
        The scans that `encode` takes; None where it takes any scan.
    positions : sequence of (x, y), mm
        Positions of the taxels, where these lie on no square grid.
    limits : (low, high), or a pair a channel, or None
        Limits of the values of a sound taxel.
    reading : Reading or None
        How the numbers of a scan are meant, where not as they come.
    verified : bool
        Whether packets carry a check of their numbers. Without one, scans are held against their
        neighbours; damage that is no jump goes unseen, and a jump of one scan is taken for damage.
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


def wire(name: str, asked: Asked | None = None) -> Wire:
    """Return a protocol by its name.

    Raises
    ------
    UnknownNameError
        If there is none of that name.
    SceneError
        If the request does not fit it.
    """
    known = asked or Asked()
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


def described_wire(path: Path, asked: Asked) -> Wire:
    """Return the protocol that a descriptor describes.

    Raises
    ------
    SceneError
        If the descriptor is wrong.
    """
    from cnnum.drivers.codecs.descriptor import read_descriptor
    from cnnum.drivers.codecs.fixed_size import FixedSize
    from cnnum.drivers.codecs.neighbours import Neighbours
    from cnnum.drivers.codecs.stream import Decoder
    from cnnum.drivers.codecs.text_rows import TextRows

    known = read_descriptor(path, asked.shape)
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


def shape_or(asked: Asked, usual: Shape) -> Shape:
    """Return the shape that the user says, or the usual one.

    Raises
    ------
    SceneError
        If it is none.
    """
    shape = asked.shape or usual
    if min(shape) < 1 or shape[0] * shape[1] > 1 << 16:
        raise SceneError(f"'shape' must be rows and columns from 1 up, got {list(shape)}.")
    return shape
