"""The thread that reads a port, decodes, and looks for the array again when it went away."""

import time
from threading import Event, Thread
from typing import Protocol

from cnnum.drivers.driver import Counters
from cnnum.drivers.mailbox import Mailbox
from cnnum.drivers.sequence import FrameClock
from cnnum.drivers.serial_packet import UNITS, Geometry, Packet
from cnnum.drivers.serial_port import SerialPort
from cnnum.drivers.serial_stream import StreamDecoder
from cnnum.errors import OtherArrayError, PortError


class Link(Protocol):
    """How a port is read and how long it is waited for; `SerialOptions` explains each."""

    @property
    def port(self) -> str: ...  # noqa: D102
    @property
    def baud(self) -> int: ...  # noqa: D102
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

    Raises
    ------
    PortError
        If the port does not open.
    """

    def __init__(self, link: Link, mail: Mailbox) -> None:
        self._link = link
        self._mail = mail
        self._decoder = StreamDecoder()
        self._clock = FrameClock()
        self._stop = Event()
        self._first: Packet | None = None
        self._started = Event()
        self._error: PortError | None = None
        self._port = SerialPort(link.port, link.baud)
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

    def first(self) -> Packet:
        """Return the first good packet, waiting for it.

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
            self._port.close()
            self._started.set()

    def _read_until_lost(self) -> None:
        lost_at = time.monotonic()
        try:
            while not self._stop.is_set():
                if self._deliver(self._packets()):
                    lost_at = time.monotonic()
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

    def _packets(self) -> list[Packet]:
        """Return the packets that have come whole.

        Raises
        ------
        PortError
            If the port has gone away; OtherArrayError if another array answers.
        """
        packets = self._decoder.feed(self._port.read())
        mine, other = self._decoder.geometry, self._decoder.stranger
        if mine is not None and other is not None:
            raise OtherArrayError(
                f"Another array answers at '{self._link.port}': {_in_words(other)} in place of "
                f"{_in_words(mine)}; connect the first one again, or start anew with this one."
            )
        return packets

    def _deliver(self, packets: list[Packet]) -> bool:
        for packet in packets:
            self._mail.put(self._clock.frame(packet))
            if self._first is None:
                self._first = packet
                self._started.set()
        return bool(packets)

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
            packets = self._try_again()
            if packets or self._stop.is_set():
                self._clock.broken(time.monotonic() - lost_at)
                self._deliver(packets)
                return
        raise PortError(
            f"{str(lost).rstrip('.')}; {self._link.reconnects} attempts to find it again failed."
        )

    def _try_again(self) -> list[Packet]:
        """Return the first packets of a port that opens and talks in time, else none."""
        try:
            self._port = SerialPort(self._link.port, self._link.baud)
            deadline = time.monotonic() + self._link.timeout
            while time.monotonic() < deadline and not self._stop.is_set():
                packets = self._packets()
                if packets:
                    return packets
        except OtherArrayError:
            raise
        except PortError:
            pass
        self._decoder.flush()
        self._port.close()
        return []

    def _silence(self) -> PortError:
        return PortError(
            f"No good packet came from '{self._link.port}' for {self._link.timeout:g} s: check "
            f"that the array is on, sends at {self._link.baud} baud, and speaks the open protocol."
        )


def _in_words(geometry: Geometry) -> str:
    """Return the layout of an array's packets."""
    names, unit = ", ".join(geometry.names), UNITS[geometry.unit]
    return f"{geometry.rows}×{geometry.cols} taxels of {names} in {unit} ({geometry.dtype})"
