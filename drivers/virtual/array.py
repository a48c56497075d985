"""The virtual array: frames in a cycle, written at a rate by the clock until it is stopped."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from threading import Event

from cnnum.arrays import Floats
from cnnum.drivers.codecs.scan import Scan
from cnnum.drivers.codecs.wire import Wire
from cnnum.drivers.virtual.faults import LineCounts, LineFaults, Spoiler
from cnnum.drivers.virtual.frames_to_scans import Fitting
from cnnum.drivers.virtual.line import VirtualLine
from cnnum.frame import Frame

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
