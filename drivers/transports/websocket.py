"""A WebSocket as a port: each message is a line of bytes. The one user of its client."""

from contextlib import ExitStack
from urllib.parse import urlsplit

from cnnum.errors import PortError, missing_extra

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
