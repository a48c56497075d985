"""A serial port with time-outs and errors that name the remedy: the one user of pyserial."""

import errno
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import serial
from serial.tools import list_ports

from cnnum.errors import PortError

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


class SerialPort:
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

    def __enter__(self) -> Self:
        """Return the port itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the port."""
        self.close()


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
