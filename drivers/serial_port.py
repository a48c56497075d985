"""Ports: a serial one, a WebSocket, and one that is listened to; errors name the remedy."""

import errno
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from threading import Lock
from urllib.parse import urlsplit

import serial
from serial.tools import list_ports

from cnnum.drivers.codecs.stream import Scan
from cnnum.drivers.codecs.wire import Asked, Decoding, Wire, protocol_names, wire
from cnnum.drivers.driver import Closing
from cnnum.errors import PortError, missing_extra

Take = Callable[[bytes, int], object]
"""Is given bytes, and when they came by the host's monotonic clock, ns."""

EARLY = 1 << 20
"""Bytes that are kept until it is known whether they are wanted."""


class Tap:
    """Hands bytes on; those that came before anyone was there are handed on first."""

    def __init__(self) -> None:
        self._early: deque[tuple[bytes, int]] | None = deque()
        self._size = 0
        self._take: Take | None = None
        self._lock = Lock()

    def add(self, data: bytes, arrived: int) -> None:
        """Take in bytes."""
        with self._lock:
            if self._take is not None:
                self._take(data, arrived)
            elif self._early is not None:
                self._early.append((data, arrived))
                self._size += len(data)
                while self._size > EARLY:
                    self._size -= len(self._early.popleft()[0])

    def begin(self) -> None:
        """Forget the early bytes: frames are taken, and no one has asked for bytes."""
        if self._early is not None:
            self.to(None)

    def to(self, take: Take | None) -> None:
        """Pass all bytes to `take` from now on, or to nobody if it is None."""
        with self._lock:
            early, self._early, self._take = self._early or (), None, take
            if take is not None:
                for data, arrived in early:
                    take(data, arrived)


TRANSPORTS_POLL = 0.05
"""s that a read waits for a message: how soon a closed driver notices."""

LARGEST = 1 << 20
"""Bytes of a message."""


def is_address(port: str) -> bool:
    """Return whether a port is the address of a WebSocket."""
    return urlsplit(port).scheme in ("ws", "wss")


class WebSocketPort:
    """An open WebSocket; reading returns the waiting bytes, and never waits for long.

    Raises
    ------
    PortError
        If it does not open, or goes away.
    MissingExtraError
        If the library is not installed.
    """

    def __init__(self, address: str) -> None:
        try:
            from websockets.exceptions import WebSocketException
            from websockets.sync.client import connect
        except ImportError:
            raise missing_extra("an array at a WebSocket", "websockets", "view") from None
        self._address = address
        self._held = ExitStack()
        self._faults = (OSError, WebSocketException)
        try:
            self._socket = self._held.enter_context(
                connect(address, open_timeout=2.0, max_size=LARGEST, proxy=None)
            )
        except (OSError, WebSocketException, ValueError) as error:
            raise PortError(
                f"The server '{address}' does not answer ({error}): start it, and check its "
                "address and port."
            ) from None

    def read(self) -> bytes:
        """Return the message that has come, as a line; nothing after `POLL` seconds without any.

        Raises
        ------
        PortError
            If the server has gone away.
        """
        try:
            message = self._socket.recv(timeout=TRANSPORTS_POLL)
        except TimeoutError:
            return b""
        except self._faults as error:
            raise PortError(f"The server '{self._address}' went away: {error}.") from None
        data = message if isinstance(message, bytes) else message.encode()
        return data.replace(b"\n", b" ") + b"\n"

    def write(self, data: bytes) -> None:
        """Send bytes to the server.

        Raises
        ------
        PortError
            If the server has gone away.
        """
        try:
            self._socket.send(data)
        except self._faults as error:
            raise PortError(f"The server '{self._address}' went away: {error}.") from None

    def close(self) -> None:
        """Let go of the socket."""
        self._held.close()


POLL = 0.05
"""s that a read waits for its first byte: how soon a closed driver notices."""


WRITE = 1.0
"""s that a write may take: an array that takes no bytes must not hold its reader up."""


def open_error(path: str, error: OSError, ports: list[str]) -> PortError:
    """Return the sentence for a port that did not open.

    Parameters
    ----------
    path : str
        The port as the user named it.
    error : OSError
        As the system or pyserial raised it.
    ports : list of str
        Ports that are there.
    """
    code = error.errno
    if code == errno.ENOENT:
        there = ", ".join(f"'{port}'" for port in ports) or "none"
        return PortError(f"There is no port '{path}': plug the array in; ports here: {there}.")
    if code in (errno.EACCES, errno.EPERM):
        return PortError(
            f"The port '{path}' may not be opened by this user: join the group 'dialout' "
            "(sudo usermod -aG dialout $USER, then log in again)."
        )
    if code in (errno.EBUSY, errno.EAGAIN):
        return PortError(f"The port '{path}' is in use by another program: close that first.")
    return PortError(f"The port '{path}' does not open as a serial port: {error}.")


class SerialPort(Closing):
    """An open port; reading returns the waiting bytes, and never waits for long.

    Raises
    ------
    PortError
        If it does not open, or goes away.
    """

    def __init__(self, path: str, baud: int) -> None:
        self._path = path
        try:
            self._port = serial.Serial(
                path, baud, timeout=POLL, write_timeout=WRITE, exclusive=True
            )
        except OSError as error:
            raise open_error(path, error, [p.device for p in list_ports.comports()]) from None
        except (ValueError, OverflowError) as error:  # the name, or a rate that no port has
            raise PortError(f"The port '{path}' does not open at {baud} baud: {error}.") from None

    def read(self) -> bytes:
        """Return the bytes that have come; none after `POLL` seconds without any.

        Raises
        ------
        PortError
            If the port has gone away.
        """
        try:
            first = self._port.read(1)
            return first + self._port.read(self._port.in_waiting) if first else b""
        except (OSError, TypeError) as error:
            raise PortError(f"The port '{self._path}' went away while reading: {error}.") from None

    def write(self, data: bytes) -> None:
        """Send bytes to the array.

        Raises
        ------
        PortError
            If the port has gone away.
        """
        try:
            self._port.write(data)
        except OSError as error:
            raise PortError(f"The port '{self._path}' went away while writing: {error}.") from None

    def close(self) -> None:
        """Let go of the port."""
        self._port.close()


@dataclass(frozen=True, slots=True)
class PortInfo:
    """A serial port of this machine.

    Attributes
    ----------
    path, about : str
    usb : str
        Maker and product, as in "1a86:55d3"; empty where it is no USB port.
    """

    path: str
    about: str
    usb: str = ""


def serial_ports() -> list[PortInfo]:
    """Return the serial ports of this machine."""
    return [
        PortInfo(
            str(port.device),
            "" if port.description in (None, "n/a") else str(port.description),
            f"{port.vid:04x}:{port.pid:04x}" if port.vid is not None else "",
        )
        for port in sorted(list_ports.comports())
    ]


KNOWN_USB = {
    "1a86:55d3": "PaXini's converter has this USB bridge: try the protocol 'paxini'",
    "16d0:14cc": "Robotiq's TSF-85 has these USB numbers: try the protocol 'robotiq-tsf85'",
    "04b4:f232": "older hubs of Robotiq's TSF-85 have these USB numbers: try 'robotiq-tsf85'",
}
"""USB numbers to a hint."""

LISTEN = 0.4
"""s that is listened at each rate."""

ENOUGH = 3
"""Scans that must come before a protocol is believed."""

SHARE = 0.8
"""Share of the bytes that must belong to packets."""


@dataclass(frozen=True, slots=True)
class Guess:
    """The array that seems to be at a port.

    Attributes
    ----------
    port : PortInfo
    protocol : str
        Empty where nothing is known.
    baud : int
        Bits a second at which it was heard; 0 where nothing was.
    said : str
        In words.
    """

    port: PortInfo
    protocol: str
    baud: int
    said: str


@dataclass(slots=True)
class _Ear:
    """A protocol that listens."""

    name: str
    decoder: Decoding
    scans: list[Scan]

    def hear(self, data: bytes) -> None:
        self.scans += self.decoder.feed(data)

    def share(self, heard: int) -> float:
        """Return the share of the bytes that belongs to good packets."""
        if len(self.scans) < ENOUGH:
            return 0.0
        return 1.0 - self.decoder.discarded / max(heard, 1)


def guess(port: PortInfo, *, seconds: float = LISTEN) -> Guess:
    """Return the array that seems to be at a port; nothing is written to it.

    An array that must be asked for its scans, or made to send, stays silent: only its USB numbers
    give a hint of it.
    """
    hint = KNOWN_USB.get(port.usb, "")
    wires = {name: wire(name, Asked()) for name in protocol_names()}
    heard_any = 0
    for baud in sorted({known.baud for known in wires.values()}, reverse=True):
        try:
            heard, ears = _listen(port.path, baud, wires, seconds)
        except PortError as error:
            return Guess(port, "", 0, str(error))
        heard_any = max(heard_any, heard)
        best = max(ears, key=lambda ear: ear.share(heard))
        if best.share(heard) >= SHARE:
            return Guess(port, best.name, baud, f"sends {best.scans[-1].kind}")
    if heard_any:
        return Guess(
            port, "", 0, f"sends {heard_any} bytes that are no known scans. {hint}".strip()
        )
    return Guess(port, "", 0, hint or "silent: it may wait to be asked, or be no array")


def _listen(
    path: str, baud: int, wires: dict[str, Wire], seconds: float
) -> tuple[int, Sequence[_Ear]]:
    ears = [_Ear(name, known.decoder(), []) for name, known in wires.items() if not known.request]
    heard, end = 0, time.monotonic() + seconds
    with SerialPort(path, baud) as port:
        while time.monotonic() < end:
            data = port.read()
            heard += len(data)
            for ear in ears:
                ear.hear(data)
    return heard, ears


def guesses(paths: Sequence[str], ports: Sequence[PortInfo]) -> list[Guess]:
    """Return a guess for every port, those of `paths` first."""
    named = [PortInfo(path, "as given") for path in paths]
    return [guess(port) for port in (*named, *ports)]
