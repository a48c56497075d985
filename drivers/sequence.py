"""From packets to frames: one running count and clock over wraps, gaps and restarts."""

from dataclasses import dataclass

import numpy as np

from cnnum.drivers.serial_packet import SATURATED, SEQUENCE_WRAP, UNITS, Packet
from cnnum.frame import Frame, Quality


@dataclass(frozen=True, slots=True)
class Step:
    """The place of a packet after the one before: the number lost, or a repeat."""

    ahead: int
    restarted: bool


def step(before: int, after: int) -> Step:
    """Compare two sequence numbers modulo 2³².

    A number less than half the range ahead has left scans out; one behind means that the device
    has started again, and the loss is unknown.
    """
    ahead = (after - before) % SEQUENCE_WRAP
    return Step(0, True) if ahead >= SEQUENCE_WRAP // 2 else Step(ahead, False)


class FrameClock:
    """Give each packet its place in the run: sequence and time never go back.

    Attributes
    ----------
    dropped : int
        Scans that the sequence numbers show to be missing.
    repeated : int
        Packets that bore the number of the one before.
    gaps : int
        Restarts and reconnections.
    sent : int
        Scans that the device has sent by its numbers, repeats included.
    """

    def __init__(self) -> None:
        self.dropped = self.repeated = self.gaps = self.sent = 0
        self._last: Packet | None = None
        self._sequence = 0
        self._time_us = 0
        self._broken: float | None = None

    def broken(self, seconds: float) -> None:
        """Note that the connection was lost, and for how long by the host's clock (s)."""
        if self._last is not None:
            self._broken = (self._broken or 0.0) + seconds

    def frame(self, packet: Packet) -> Frame:
        """Return the packet's frame; its time counts from the first one."""
        quality = Quality.SATURATED if packet.flags & SATURATED else Quality.GOOD
        return Frame(
            values=np.asarray(packet.values, dtype=np.float64),
            channels=packet.geometry.names,
            unit=UNITS[packet.geometry.unit],
            quality=quality | self._advance(packet),
            sequence=self._sequence,
            time=self._time_us * 1e-6,
        )

    def _advance(self, packet: Packet) -> Quality:
        last, self._last = self._last, packet
        if last is None:
            self._sequence, self.sent = packet.sequence, 1
            return Quality.GOOD
        away, self._broken = self._broken, None
        moved = step(last.sequence, packet.sequence)
        elapsed = packet.time_us - last.time_us
        if moved.restarted or elapsed < 0 or _began_anew(away, elapsed):
            return self._restart(away, packet.period_us)
        self._time_us += elapsed
        self.gaps += away is not None
        return self._go_on(moved.ahead)

    def _restart(self, away: float | None, period_us: int) -> Quality:
        """Go on after a device that counts anew: by the host's clock, or by one period."""
        self.gaps += 1
        away_us = round((away or 0.0) * 1e6)
        self._time_us += away_us or period_us
        # scans that its period makes of the time away, the present one among them
        self._go_on(max(1, round(away_us / period_us)) if period_us else 1)
        return Quality.DROPPED_BEFORE

    def _go_on(self, ahead: int) -> Quality:
        """Count the scans up to the present one."""
        self._sequence += ahead
        self.sent += max(1, ahead)
        if ahead == 0:
            self.repeated += 1
            return Quality.REPEATED
        self.dropped += ahead - 1
        return Quality.DROPPED_BEFORE if ahead > 1 else Quality.GOOD


def _began_anew(away: float | None, elapsed_us: int) -> bool:
    """Return whether a device that came back has a clock that ran for less than half the time."""
    return away is not None and elapsed_us < 0.5e6 * away
