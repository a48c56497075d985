"""A virtual array: a simulated one behind a pseudo-terminal, in any protocol, with faults."""

import contextlib
import os
import random
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.codecs.stream import Scan
from cnnum.drivers.codecs.wire import Form, Wire
from cnnum.drivers.options import require
from cnnum.errors import NotSupportedError, PortError
from cnnum.frame import Frame


@dataclass(frozen=True, slots=True)
class LineFaults:
    """Faults of a line.

    Attributes
    ----------
    drops, flips : float
        Shares of the packets that are left out, and that get one bit turned over; 0 to 1.
    stall_every, stall : float
        s from one pause of the array to the next, and how long each is; 0 for none.
    unplug_every, away : float
        s from one unplug to the next, and how long each is; 0 for none.
    seed : int
    """

    drops: float = 0.0
    flips: float = 0.0
    stall_every: float = 0.0
    stall: float = 0.5
    unplug_every: float = 0.0
    away: float = 0.5
    seed: int = 0

    def __post_init__(self) -> None:
        require("drops", 0 <= self.drops <= 1, "a share from 0 to 1", self.drops)
        require("flips", 0 <= self.flips <= 1, "a share from 0 to 1", self.flips)
        for key in ("stall_every", "stall", "unplug_every", "away"):
            value = getattr(self, key)
            require(key, 0 <= value < 3600, "seconds below 3600, or 0", value)


@dataclass(slots=True)
class LineCounts:
    """The work of a virtual array: ``scans = whole + dropped + flipped + untaken``.

    Attributes
    ----------
    scans : int
        That the array made.
    whole, flipped : int
        Written as they are, and with a bit turned over.
    dropped : int
        Left out on request.
    untaken : int
        Left out because the reader took nothing, or nothing was plugged in.
    stalls, unplugs : int
    """

    scans: int = 0
    whole: int = 0
    flipped: int = 0
    dropped: int = 0
    untaken: int = 0
    stalls: int = 0
    unplugs: int = 0


class Spoiler:
    """Drops and damages packets by their shares.

    Parameters
    ----------
    faults : LineFaults
    """

    def __init__(self, faults: LineFaults) -> None:
        self._faults = faults
        self._rng = random.Random(faults.seed)

    def drops(self) -> bool:
        """Return whether the next packet is left out."""
        return self._rng.random() < self._faults.drops

    def flipped(self, packet: bytes) -> bytes | None:
        """Return the packet with one bit turned over, or None if it stays as it is."""
        if not self._rng.random() < self._faults.flips:
            return None
        damaged = bytearray(packet)
        damaged[self._rng.randrange(len(packet))] ^= 1 << self._rng.randrange(8)
        return bytes(damaged)


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
                f"The link '{self._link}' cannot be made: {error.strerror}; choose an existing "
                "folder in which you may write."
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


LIKE = {"flux_x": "shear_x", "flux_y": "shear_y", "flux_z": "normal"}
"""Channels that follow a load as another one does."""

WARM = 25.0
"""°C of a sensor that measures its temperature."""


class Fitting:
    """Takes the taxels nearest to those of a form, and loads to the range of its numbers.

    Parameters
    ----------
    form : Form
    frames : sequence of Frame
        All frames of the run; the largest number of each channel sets the form's strong load.
    """

    def __init__(self, form: Form, frames: Sequence[Frame]) -> None:
        self._form = form
        known, (rows, cols) = frames[0], form.shape
        names = [LIKE.get(name, name) for name in form.channels]
        self._channels = [known.channels.index(n) if n in known.channels else None for n in names]
        self._rows = np.arange(rows) * known.shape[0] // rows
        self._cols = np.arange(cols) * known.shape[1] // cols
        rest = np.median(np.stack([frame.values for frame in frames[:16]]), axis=0)
        self._rest = rest
        away = [np.abs(frame.values - rest).max(axis=(0, 1)) for frame in frames]
        self._largest = np.maximum(np.max(away, axis=0), 1e-30)

    def __call__(self, frame: Frame) -> Floats:
        """Return (rows, cols, channels) numbers of the form."""
        form = self._form
        loads = (frame.values - self._rest) / self._largest
        near = loads[self._rows][:, self._cols]
        values = np.full((*form.shape, len(form.channels)), form.rest)
        for at, (name, source) in enumerate(zip(form.channels, self._channels, strict=True)):
            if name == "temperature":
                values[..., at] = WARM
            elif source is not None:
                load = near[..., source]
                signed = name != "normal" or form.rest > 0
                values[..., at] += (form.full - form.rest) * (load if signed else np.abs(load))
        return values


POLL = 0.002
"""s between looks for a request, of an array that is asked for scans."""


@dataclass(slots=True, eq=False)
class VirtualArray:
    """An array at a line.

    Attributes
    ----------
    wire : Wire
    line : VirtualLine
    frames : sequence of Frame
        One cycle; after its last frame the first comes again.
    rate : float
        Hz.
    faults : LineFaults
    counts : LineCounts
    """

    wire: Wire
    line: VirtualLine
    frames: Sequence[Frame]
    rate: float
    faults: LineFaults = field(default_factory=LineFaults)
    counts: LineCounts = field(default_factory=LineCounts)

    def run(self, stop: Event, seconds: float | None = None) -> LineCounts:
        """Send scans until `stop` is set, or for `seconds`, and return the counts."""
        spoiler, values = Spoiler(self.faults), self._values()
        begin = time.monotonic()
        stall = _Alarm(self.faults.stall_every)
        unplug = _Alarm(self.faults.unplug_every)
        while not stop.is_set():
            at = self.counts.scans / self.rate
            if seconds is not None and at >= seconds:
                break
            if self.faults.unplug_every and unplug.rings(at):
                self._leave(at, begin, stop)
            elif self.faults.stall_every and stall.rings(at):
                self.counts.stalls += 1
                stop.wait(self.faults.stall)
            wait = begin + self.counts.scans / self.rate - time.monotonic()
            if wait > 0:
                time.sleep(wait)
            if self.wire.request and not self._wait_for_request(stop):
                break
            self._send(values(self.counts.scans), spoiler)
        return self.counts

    def _values(self) -> Callable[[int], Floats]:
        """Return the numbers of a scan by its number, as the protocol sends them."""
        if self.wire.form is None:
            every = [frame.values for frame in self.frames]
        else:
            every = list(map(Fitting(self.wire.form, self.frames), self.frames))
        return lambda number: every[number % len(every)]

    def _send(self, values: Floats, spoiler: Spoiler) -> None:
        form, first, counts = self.wire.form, self.frames[0], self.counts
        number = counts.scans
        counts.scans += 1
        if spoiler.drops():
            counts.dropped += 1
            return
        packet = self.wire.encode(
            Scan(
                values=values,
                channels=form.channels if form else first.channels,
                unit=form.unit if form else first.unit,
                sequence=number,
                time_us=round(1e6 * number / self.rate),
                period_us=round(1e6 / self.rate),
            )
        )
        damaged = spoiler.flipped(packet)
        if not self.line.write(damaged or packet):
            counts.untaken += 1
        elif damaged:
            counts.flipped += 1
        else:
            counts.whole += 1

    def _leave(self, at: float, begin: float, stop: Event) -> None:
        """Unplug for a while; the array itself goes on, and its scans of that time are lost."""
        self.counts.unplugs += 1
        time.sleep(max(0.0, begin + at - time.monotonic()))
        self.line.unplug()
        stop.wait(self.faults.away)
        gone = max(0, int((time.monotonic() - begin) * self.rate) - self.counts.scans)
        self.counts.scans += gone
        self.counts.untaken += gone
        self.line.plug()

    def _wait_for_request(self, stop: Event) -> bool:
        """Return whether the reader has asked for a scan; False if `stop` is set."""
        while not stop.is_set():
            if self.wire.request in self.line.asked():
                return True
            time.sleep(POLL)
        return False


class _Alarm:
    """Rings once whenever its time has gone by."""

    def __init__(self, every: float) -> None:
        self._every = self._next = every

    def rings(self, at: float) -> bool:
        """Return whether it rings at a time, s."""
        if at < self._next:
            return False
        self._next += self._every
        return True
