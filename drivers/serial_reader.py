"""The thread that reads a port, decodes, and looks for the array again when it went away."""

import time
from threading import Event, Thread
from typing import Protocol

from cnnum.drivers.codecs.scan import Scan
from cnnum.drivers.codecs.wire import Wire
from cnnum.drivers.driver import Counters
from cnnum.drivers.mailbox import Mailbox
from cnnum.drivers.serial_port import SerialPort
from cnnum.drivers.timing.clock_fit import ClockFit
from cnnum.drivers.timing.sequence import FrameClock
from cnnum.drivers.transports.tap import Tap
from cnnum.drivers.transports.websocket import WebSocketPort, is_address
from cnnum.errors import OtherArrayError, PortError

SETTLED = 1.0
"""s of a stream after which the array is asked to zero itself, where the user wants it."""

ASK_AGAIN = 0.25
"""s after which an array that is asked for each scan is asked once more."""


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
