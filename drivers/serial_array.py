"""A tactile array at a port: the thread that reads it, and the driver that passes on its frames."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event, Thread
from typing import Literal, Protocol

from cnnum.arrays import Shape
from cnnum.drivers.codecs.stream import Scan
from cnnum.drivers.codecs.wire import Asked, Wire, described_wire, wire
from cnnum.drivers.driver import Closing, Counters, Mailbox
from cnnum.drivers.options import require
from cnnum.drivers.serial_port import SerialPort, Take, Tap, WebSocketPort, is_address
from cnnum.drivers.timing import ClockFit, FrameClock
from cnnum.errors import OtherArrayError, PortError
from cnnum.frame import Frame, Quality

SETTLED = 1.0
"""Time, s, after which a streaming array is made to zero itself, if the user wants that."""

ASK_AGAIN = 0.25
"""Time, s, after which a request for a scan is repeated."""


class Link(Protocol):
    """How a port is read and how long it is waited for; `SerialOptions` explains each."""

    @property
    def port(self) -> str: ...  # noqa: D102
    @property
    def baud(self) -> int | None: ...  # noqa: D102
    @property
    def timeout(self) -> float: ...  # noqa: D102
    @property
    def reconnects(self) -> int: ...  # noqa: D102
    @property
    def backoff(self) -> float: ...  # noqa: D102
    @property
    def longest_backoff(self) -> float: ...  # noqa: D102


class SerialReader:
    """Reads from a thread of its own into a mailbox, from the moment that it is made.

    Attributes
    ----------
    tap : Tap
        Gets the bytes as they come.

    Raises
    ------
    PortError
        If the port does not open.
    """

    def __init__(self, link: Link, wire: Wire, mail: Mailbox) -> None:
        self._link, self._wire = link, wire
        self._baud = link.baud or wire.baud
        self._mail = mail
        self._decoder = wire.decoder()
        self._clock = FrameClock()
        self._stop = Event()
        self._first: Scan | None = None
        self._started = Event()
        self._error: PortError | None = None
        self._settle_at = self._ask_at = 0.0
        self.tap = Tap()
        self._port = self._open()
        self._thread = Thread(target=self._run, name=f"read {link.port}", daemon=True)
        self._thread.start()

    @property
    def counters(self) -> Counters:
        """The counts of the decoder and the clock."""
        return Counters(
            frames=self._decoder.good,
            bad=self._decoder.bad,
            dropped=self._clock.dropped,
            repeated=self._clock.repeated,
            resyncs=self._decoder.resyncs,
            discarded=self._decoder.discarded,
            gaps=self._clock.gaps,
            sent=self._clock.sent,
        )

    @property
    def clock(self) -> ClockFit:
        """The device's clock against the host's."""
        return self._clock.fit

    def first(self) -> Scan:
        """Return the first good scan, waiting for it.

        Raises
        ------
        PortError
            If none comes in time.
        """
        self._started.wait(self._link.timeout + 1.0)
        if self._first is not None:
            return self._first
        if self._error is not None:
            raise self._error
        raise self._silence()

    def close(self) -> None:
        """Stop the thread and close the port."""
        self._stop.set()
        self._thread.join()
        self._mail.end()

    def _run(self) -> None:
        """Read until the call to stop, or until the array is gone for good."""
        try:
            while not self._stop.is_set():
                self._read_until_lost()
        except PortError as error:
            self._error = error
            self._mail.end(error)
        finally:
            self._leave()
            self._started.set()

    def _open(self) -> "SerialPort | WebSocketPort":
        """Open the port, and send the array its request."""
        known = self._link.port
        port = WebSocketPort(known) if is_address(known) else SerialPort(known, self._baud)
        try:
            if self._wire.greeting:
                port.write(self._wire.greeting)
        except PortError:
            port.close()
            raise
        self._settle_at, self._ask_at = 0.0, 0.0
        return port

    def _leave(self) -> None:
        """Close the port; an array that was made to send gets the request to stop."""
        try:
            if self._wire.farewell:
                self._port.write(self._wire.farewell)
        except PortError:
            pass  # it is gone: it needs no request
        self._port.close()

    def _read_until_lost(self) -> None:
        lost_at = time.monotonic()
        try:
            while not self._stop.is_set():
                if self._deliver(self._scans()):
                    lost_at = time.monotonic()
                    self._settle(lost_at)
                elif time.monotonic() - lost_at > self._link.timeout:
                    raise self._silence()
        except OtherArrayError:
            raise
        except PortError as error:
            self._deliver(self._decoder.flush())
            self._port.close()
            if self._first is None:
                raise
            self._reconnect(error, lost_at)

    def _settle(self, now: float) -> None:
        """Ask the array to zero itself once its stream has run for a while."""
        if not self._wire.settled:
            return
        if not self._settle_at:
            self._settle_at = now + SETTLED
        elif now >= self._settle_at:
            self._settle_at = float("inf")
            self._port.write(self._wire.settled)

    def _scans(self) -> list[Scan]:
        """Return the scans that have come whole.

        Raises
        ------
        PortError
            If the port has gone away; OtherArrayError if another array answers.
        """
        if self._wire.request and time.monotonic() >= self._ask_at:
            self._decoder.flush(lost=False)  # half an answer must not run into the next
            self._ask_at = time.monotonic() + ASK_AGAIN
            self._port.write(self._wire.request)
        data = self._port.read()
        if data:
            self.tap.add(data, time.monotonic_ns())
        scans = self._decoder.feed(data)
        if scans:
            self._ask_at = 0.0
        if self._decoder.conflict:
            raise self._other(self._decoder.conflict)
        if self._first is not None:
            for scan in scans:
                if scan.values.shape != self._first.values.shape or scan.unit != self._first.unit:
                    raise self._other(f"{scan.kind} in place of {self._first.kind}")
        return scans

    def _other(self, said: str) -> OtherArrayError:
        return OtherArrayError(
            f"Another array answers at '{self._link.port}': {said}; connect the first one again, "
            "or start anew with this one."
        )

    def _deliver(self, scans: list[Scan]) -> bool:
        arrived = time.monotonic_ns()
        for scan in scans:
            self._mail.put(self._clock.frame(scan, arrived))
            if self._first is None:
                self._first = scan
                self._started.set()
        return bool(scans)

    def _reconnect(self, lost: PortError, lost_at: float) -> None:
        """Open the port again, waiting longer from time to time.

        Raises
        ------
        PortError
            If all attempts failed.
        """
        wait = self._link.backoff
        for _ in range(self._link.reconnects):
            if self._stop.wait(wait):
                return
            wait = min(2 * wait, self._link.longest_backoff)
            scans = self._try_again()
            if scans or self._stop.is_set():
                self._clock.broken(time.monotonic() - lost_at)
                self._deliver(scans)
                return
        raise PortError(
            f"{str(lost).rstrip('.')}; {self._link.reconnects} attempts to find it again failed."
        )

    def _try_again(self) -> list[Scan]:
        """Return the first scans of a port that opens and talks in time, else none."""
        try:
            self._port = self._open()
            deadline = time.monotonic() + self._link.timeout
            while time.monotonic() < deadline and not self._stop.is_set():
                scans = self._scans()
                if scans:
                    return scans
        except OtherArrayError:
            raise
        except PortError:
            pass
        self._decoder.flush()
        self._port.close()
        return []

    def _silence(self) -> PortError:
        lost = self._decoder.discarded
        trouble = str(getattr(self._decoder, "trouble", ""))
        if trouble:
            return PortError(
                f"No scan came from '{self._link.port}' for {self._link.timeout:g} s: {trouble}"
            )
        seen = f"{lost} bytes came that are none" if lost else "Nothing came that is any"
        return PortError(
            f"No good packet came from '{self._link.port}' for {self._link.timeout:g} s: check "
            f"that the array is on, sends at {self._baud} baud, and speaks {self._wire.name}. "
            f"{seen} of its packets."
        )


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
        A TOML file that describes the protocol, instead of a name.
    shape : (rows, cols), optional
        Shape of an array whose protocol does not state it.
    rate : float
        Scan rate in Hz to request from the array, if its protocol allows that; 0 leaves it
        unchanged.
    address : int
        Address of the device behind the port, if there are several.
    bias : bool
        Whether to make the array zero itself once it has run for a second. It must be unloaded.
    baud : int, optional
        Bits per second, at most 10⁸. The default is that of the protocol.
    mode : "every" or "latest"
        Whether to deliver every scan in order (to record), or only the newest one (to watch).
    timeout : float
        Time without a good packet, s, after which the array counts as disconnected.
    reconnects : int
        Number of attempts to find a lost array before `PortError`; 0 gives up at once.
    backoff : float
        Time before the first attempt, s; doubled for each further one, up to `longest_backoff`.
    longest_backoff : float
        Longest time between attempts, s, below 3600.
    depth : int
        Number of scans that may wait for a slow reader in mode "every", at most 10⁶. If there are
        more, the oldest are dropped and counted.
    stale : float
        Time that a scan may wait for its reader, s; one that waited longer has the flag `STALE`.
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
            If there is no protocol of that name, or the descriptor is wrong.
        """
        options = Asked(self.shape, self.rate, self.address, self.bias)
        if self.descriptor is not None:
            return described_wire(self.descriptor, options)
        return wire(self.protocol, options)

    def open(self) -> "SerialArray":
        """Open the port and wait for the first scan.

        Raises
        ------
        PortError
            If the port cannot be opened, or no good packet arrives within `timeout`.
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
