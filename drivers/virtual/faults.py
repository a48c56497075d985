"""Faults of a line, on request and repeatable."""

import random
from dataclasses import dataclass

from cnnum.drivers.options import require


@dataclass(frozen=True, slots=True)
class LineFaults:
    """What goes wrong on a line.

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
    """What a virtual array did: ``scans = whole + dropped + flipped + untaken``.

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
