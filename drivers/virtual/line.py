"""A pseudo-terminal as the device's end of a serial line, which can be unplugged."""

import contextlib
import os
import re
from pathlib import Path

from cnnum.errors import NotSupportedError, PortError

WAITING = 1 << 22
"""Bytes that wait for the reader, as in a device's own buffer; more are not taken."""


TERMINALS = r"/dev/(pts/|ttys)\d+"
"""Names of pseudo-terminals: of Linux, and of macOS."""


class VirtualLine:
    """A line at a path: a link to the pseudo-terminal that is plugged in.

    Parameters
    ----------
    link : Path, optional
        The name that stays the same over replugs; the terminal's own unless given.

    Raises
    ------
    NotSupportedError
        If the system has no pseudo-terminals.
    PortError
        If the link cannot be made, or something else has its name.
    """

    def __init__(self, link: Path | None = None) -> None:
        if not hasattr(os, "openpty"):
            raise NotSupportedError(
                "This system has no pseudo-terminals: simulate the array on Linux or macOS."
            )
        if link is not None and _foreign(link):
            raise PortError(
                f"'{link}' exists and is not a link to a pseudo-terminal: choose another name."
            )
        self._link = link
        self._master = self._slave = -1
        self._waiting = bytearray()
        self.path = link
        self.plug()

    @property
    def plugged(self) -> bool:
        """Whether a terminal is there."""
        return self._master >= 0

    def plug(self) -> None:
        """Open a new terminal, and lead the link to it.

        Raises
        ------
        PortError
            If the link cannot be made.
        """
        import tty

        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        name = Path(os.ttyname(self._slave))
        if self._link is None:
            self.path = name
            return
        try:
            if not _foreign(self._link):  # one that was left by a line that was killed
                self._link.unlink(missing_ok=True)
            self._link.symlink_to(name)
        except OSError as error:
            raise PortError(
                f"The link '{self._link}' cannot be made: {error.strerror}; choose a folder that "
                "exists and may be written to."
            ) from None

    def unplug(self) -> None:
        """Close the terminal; its reader sees that it has gone."""
        # first the link: another program may get the number of a terminal that is closed
        if self._link is not None:
            with contextlib.suppress(OSError):
                if not _foreign(self._link):
                    self._link.unlink(missing_ok=True)
        if self.plugged:
            os.close(self._slave)
            os.close(self._master)
            self._master = self._slave = -1
        self._waiting.clear()

    def write(self, data: bytes) -> bool:
        """Leave bytes for the reader, and return whether they were taken, all or none."""
        if not self.plugged or len(self._waiting) + len(data) > WAITING:
            self._push()
            return False
        self._waiting += data
        self._push()
        return True

    def _push(self) -> None:
        while self._waiting and self.plugged:
            try:
                count = os.write(self._master, self._waiting[:4096])
            except BlockingIOError:
                return
            except OSError:  # the reader has gone; another may come
                return
            del self._waiting[:count]

    def asked(self) -> bytes:
        """Return the bytes that the reader has written."""
        self._push()
        try:
            return os.read(self._master, 4096) if self.plugged else b""
        except OSError:  # nothing yet, or the reader has gone
            return b""

    def close(self) -> None:
        """Unplug for good."""
        self.unplug()


def _foreign(link: Path) -> bool:
    """Return whether something that is no link to a pseudo-terminal has this name.

    Ports of devices lie beside them: "/dev/ttyUSB0", "/dev/ttyS0" and "/dev/tty.usbmodem1".
    """
    if link.is_symlink():
        return not re.fullmatch(TERMINALS, str(link.readlink()))
    return link.exists()
