"""Gaps of a stream as records of their own: missed scans are said when they are missed."""

from dataclasses import dataclass

from cnnum.frame import Frame, Quality

LONG = 0.1
"""s; a gap at least as long has a record of its own."""

APART = 1.0
"""s between records of shorter gaps, which are counted together."""


@dataclass(frozen=True, slots=True)
class Gap:
    """Scans that never came, before a frame.

    Attributes
    ----------
    time : float
        s, of the first frame after it.
    frame : int
        Number of that frame.
    seconds : float
        From the frame before to that one; of several gaps the longest.
    missing : int
        Scans.
    gaps : int
        Gaps since the record before, this one among them.
    """

    time: float
    frame: int
    seconds: float
    missing: int
    gaps: int = 1

    def record(self) -> dict[str, object]:
        """Return it as a record of `--json`."""
        return {
            "kind": "gap",
            "t": round(self.time, 6),
            "frame": self.frame,
            "seconds": round(self.seconds, 6),
            "missing": self.missing,
            "gaps": self.gaps,
        }

    def __str__(self) -> str:
        many = f"{self.gaps} gaps, the longest" if self.gaps > 1 else "gap"
        scans = "scan" if self.missing == 1 else "scans"
        return f"{self.time:9.3f} s  {many} {self.seconds:.3f} s, {self.missing} {scans} missing"


class GapWatch:
    """Notices gaps by the flags of the frames."""

    def __init__(self) -> None:
        self._last: Frame | None = None
        self._said = float("-inf")
        self._gaps = self._missing = 0
        self._longest = 0.0

    def seen(self, number: int, frame: Frame) -> Gap | None:
        """Take in a frame, and return the gap that it says, if it is time to say one."""
        last, self._last = self._last, frame
        if last is None or not frame.quality & Quality.DROPPED_BEFORE:
            return None
        seconds = frame.time - last.time
        self._gaps += 1
        self._missing += max(0, frame.sequence - last.sequence - 1)
        self._longest = max(self._longest, seconds)
        if seconds < LONG and 0.0 <= frame.time - self._said < APART:
            return None
        gap = Gap(frame.time, number, self._longest, self._missing, self._gaps)
        self._said, self._gaps, self._missing, self._longest = frame.time, 0, 0, 0.0
        return gap
