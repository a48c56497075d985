"""The device's clock against the host's: how long scans were on their way, and the drift."""

import math
from collections import deque

import numpy as np

from cnnum.arrays import Floats

PIECE = 0.25
"""s of the device's clock; the earliest arrival of each such piece is kept."""

KEPT = 256
"""Pieces: about a minute."""


class ClockFit:
    """A line through the earliest arrivals: bytes can be late on their way, never early.

    Attributes
    ----------
    drift : float
        Seconds that the host's clock gains on the device's a second; 0 before there is enough.
    """

    def __init__(self) -> None:
        self._pieces: deque[tuple[float, float]] = deque(maxlen=KEPT)
        self.restart()

    def restart(self) -> None:
        """Forget all: the device's clock began anew."""
        self._pieces.clear()
        self._earliest: tuple[float, float] | None = None
        self._begin, self._offset, self.drift = 0.0, math.nan, 0.0

    def add(self, device: float, host: float) -> None:
        """Take in a scan's time on the device's clock and its arrival on the host's, s."""
        late = host - device
        if self._earliest is None:
            self._begin, self._earliest = device, (device, late)
            self._offset = late if math.isnan(self._offset) else self._offset
            return
        if late < self._earliest[1]:
            self._earliest = (device, late)
        if device - self._begin >= PIECE:
            self._pieces.append(self._earliest)
            self._earliest = None
            self._fit()

    def delay(self, device: float, host: float) -> float:
        """Return the s that a scan waited beyond the quickest way; 0 before the first scan."""
        if math.isnan(self._offset):
            return 0.0
        return max(0.0, host - device - self._offset - self.drift * device)

    def _fit(self) -> None:
        times: Floats = np.array([piece[0] for piece in self._pieces])
        late: Floats = np.array([piece[1] for piece in self._pieces])
        if len(times) >= 8:
            away = times - times.mean()
            self.drift = float(away @ late / (away @ away))
        self._offset = float((late - self.drift * times).min())
