"""Transports: where bytes come from, when it is no serial port."""

from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from threading import Lock
from urllib.parse import urlsplit

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


POLL = 0.05
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
            message = self._socket.recv(timeout=POLL)
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
