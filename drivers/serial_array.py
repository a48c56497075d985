"""A tactile array at a port: the open protocol (``docs/serial-protocol.md``), or one of others."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from cnnum.arrays import Shape
from cnnum.drivers.codecs.wire import Asked, Wire, described_wire, wire
from cnnum.drivers.driver import Closing, Counters
from cnnum.drivers.mailbox import Mailbox
from cnnum.drivers.options import require
from cnnum.drivers.serial_reader import SerialReader
from cnnum.drivers.timing.clock_fit import ClockFit
from cnnum.drivers.transports.tap import Take
from cnnum.errors import PortError
from cnnum.frame import Frame, Quality

LONGEST_PORT = 4096
"""Signs of a port's name; no system has a longer one."""


@dataclass(frozen=True, slots=True)
class SerialOptions:
    """Options of the driver "serial".

    Attributes
    ----------
    port : str
        "/dev/ttyACM0", "COM3"…, or the address of a WebSocket, "ws://127.0.0.1:5000".
    protocol : str
        The protocol of the array: "open", or another of `protocol_names()`.
    descriptor : Path, optional
        A TOML file that describes the protocol, in place of a name.
    shape : (rows, cols), optional
        Shape of an array whose protocol does not say it.
    rate : float
        Hz that the array is asked for, where its protocol can; 0 leaves it as it is.
    address : int
        Address of the device behind the port, where there are several.
    bias : bool
        Whether the array is asked to zero itself when it has run for a second: unloaded only.
    baud : int, optional
        Bits a second, at most 10⁸; the protocol's unless given.
    mode : "every" or "latest"
        Hand on every scan in order (to record), or the newest one only (to watch).
    timeout : float
        s without a good packet after which the array counts as gone.
    reconnects : int
        Times that a lost array is looked for before `PortError`; 0 gives up at once.
    backoff : float
        s before the first of these times; doubled each time, up to `longest_backoff`.
    longest_backoff : float
        s, below 3600.
    depth : int
        Scans that may wait for a slow reader in mode "every", at most 10⁶. Beyond it the oldest are
        dropped and counted.
    stale : float
        s that a scan may wait for its reader; one that waited longer has the flag `STALE`.
    """

    port: str
    protocol: str = "open"
    descriptor: Path | None = None
    shape: tuple[int, int] | None = None
    rate: float = 0.0
    address: int = 1
    bias: bool = False
    baud: int | None = None
    mode: Literal["every", "latest"] = "every"
    timeout: float = 2.0
    reconnects: int = 5
    backoff: float = 0.25
    longest_backoff: float = 4.0
    depth: int = 4096
    stale: float = 5.0

    def __post_init__(self) -> None:
        named = 0 < len(self.port) < LONGEST_PORT and self.port.isprintable()
        require("port", named, "the name of a port", self.port)
        holds = self.baud is None or 0 < self.baud <= 10**8
        require("baud", holds, "bits a second, 1 to 100000000", self.baud)
        rows, cols = self.shape or (1, 1)
        holds = min(rows, cols) >= 1 and rows * cols <= 1 << 16
        require("shape", holds, "rows and columns from 1 up", self.shape)
        require("rate", 0 <= self.rate < 1e6, "Hz below 1e6, or 0", self.rate)
        require("address", 0 < self.address < 256, "a number from 1 to 255", self.address)
        require("stale", self.stale > 0, "seconds above 0", self.stale)
        require("timeout", 0 < self.timeout < 3600, "seconds above 0, below 3600", self.timeout)
        require("reconnects", self.reconnects >= 0, "a number of times, or 0", self.reconnects)
        require("backoff", self.backoff > 0, "seconds above 0", self.backoff)
        longest = self.longest_backoff
        holds = self.backoff <= longest < 3600
        require("longest_backoff", holds, "seconds, at least 'backoff', below 3600", longest)
        require("depth", 0 < self.depth <= 10**6, "a number of frames, 1 to 1000000", self.depth)

    @property
    def wire(self) -> Wire:
        """The protocol.

        Raises
        ------
        UnknownNameError, SceneError
            If there is none of that name, or the descriptor is wrong.
        """
        asked = Asked(self.shape, self.rate, self.address, self.bias)
        if self.descriptor is not None:
            return described_wire(self.descriptor, asked)
        return wire(self.protocol, asked)

    def open(self) -> "SerialArray":
        """Open the port and wait for the first scan.

        Raises
        ------
        PortError
            If the port does not open, or brings no good packet within `timeout`.
        """
        return SerialArray(self)


class SerialArray(Closing):
    """An array at a port: a thread reads and decodes, `frames` hands on.

    Attributes
    ----------
    live : bool
        True: frames that were taken are gone.

    Raises
    ------
    PortError
        If the port does not open, or brings no good packet in time.
    """

    live = True

    def __init__(self, options: SerialOptions) -> None:
        self._options = options
        latest = options.mode == "latest"
        self._mail = Mailbox(1 if latest else options.depth, lost=not latest)
        self._reader = SerialReader(options, options.wire, self._mail)
        self._handed_on = 0
        try:
            first = self._reader.first()
        except PortError:
            self._reader.close()
            raise
        rows, cols, _ = first.values.shape
        self.shape: Shape = (rows, cols)
        self.channels = first.channels
        self.unit = first.unit
        known = options.wire
        self.positions, self.limits, self._reading = known.positions, known.limits, known.reading
        if self._reading is not None:
            self.limits = self._reading.limits(self.limits, len(self.channels))
        self.rate = 1e6 / first.period_us if first.period_us else 0.0

    @property
    def verified(self) -> bool:
        """Whether the protocol's packets carry a check of their numbers."""
        return self._options.wire.verified

    @property
    def counters(self) -> Counters:
        """The counts so far."""
        seen = self._reader.counters
        pushed_out, waiting = self._mail.pushed_out, self._mail.waiting
        latest = self._options.mode == "latest"
        return Counters(
            frames=self._handed_on,
            bad=seen.bad,
            dropped=seen.dropped + (0 if latest else pushed_out),
            repeated=seen.repeated,
            skipped=pushed_out if latest else 0,
            resyncs=seen.resyncs,
            discarded=seen.discarded,
            gaps=seen.gaps,
            waiting=waiting,
            sent=seen.sent,
        )

    def frames(self) -> Iterator[Frame]:
        """Yield frames as they come, until `close`.

        Raises
        ------
        PortError
            If the array went away and did not come back in the attempts that the options allow.
        """
        self._reader.tap.begin()
        while (frame := self._mail.get()) is not None:
            self._handed_on += not frame.repeated
            waited = time.monotonic_ns() - (frame.monotonic_ns or 0)
            if waited > 1e9 * self._options.stale:
                frame = replace(frame, quality=frame.quality | Quality.STALE)
            yield frame if self._reading is None else self._reading.frame(frame)

    def tap(self, take: Take | None) -> None:
        """Pass the bytes of the port to `take` as they arrive; with None, stop doing so.

        Those that came before are kept until then, 1 MiB at most; none are once frames are taken.
        """
        self._reader.tap.to(take)

    @property
    def clock(self) -> ClockFit:
        """The device's clock against the host's."""
        return self._reader.clock

    def close(self) -> None:
        """Stop reading and let go of the port."""
        self._reader.close()
