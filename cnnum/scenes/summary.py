"""The summary of a scene: frames by outcome, and their times."""

from dataclasses import dataclass

from cnnum.drivers.driver import Counters


@dataclass(frozen=True, slots=True)
class Summary:
    """The summary of a scene: ``sent == handed_on + dropped + skipped + refused``.

    Attributes
    ----------
    frames : int
        Handed on by the driver; bad and repeated ones are among them. Those that ran silently,
        before the part that was asked for, are not.
    handed_on : int
        Those that the program ran on.
    refused : int
        Bad ones that were passed over: flagged by the driver, out of range, or of a kind that the
        program cannot work with.
    repeated : int
        Repeats of the scan before.
    counters : Counters
        The driver's own.
    saturated : int
        Frames with a taxel at an end of its range because of a load: loads in them are lower
        bounds.
    masked : int
        Frames with a taxel that had dropped out, and went on as its neighbours did.
    dropouts : int
        Times that a taxel has dropped out.
    longest_gap : float
        s, the longest time between two frames that the program ran on. A bad or a lost one lies
        between them; 0 where there was none.
    p50_us, p99_us : float
        Time from a frame in host memory to its events, µs, within 1 %.
    arrival_p50_us, arrival_p99_us : float or None
        Time from a frame's arrival at its port to its events, µs; None where none just came.
    before : int
        Frames that ran silently, before the part that was asked for.
    """

    frames: int
    handed_on: int
    refused: int
    repeated: int
    counters: Counters
    longest_gap: float
    p50_us: float
    p99_us: float
    arrival_p50_us: float | None = None
    arrival_p99_us: float | None = None
    before: int = 0
    saturated: int = 0
    masked: int = 0
    dropouts: int = 0

    @property
    def bad_frames(self) -> int:
        """Those refused, and packets or rows that the driver found damaged itself."""
        return self.refused + self.counters.bad

    @property
    def dropped(self) -> int:
        """Scans that were lost on the way; packets found damaged are among them."""
        return self.counters.dropped

    @property
    def skipped(self) -> int:
        """Scans that were not wanted: older ones, repeats, those before and after the part."""
        cut_off = self.frames - self.handed_on - self.refused - self.repeated
        return self.counters.skipped + self.repeated + cut_off + self.counters.waiting + self.before

    @property
    def sent(self) -> int:
        """Scans that the array says it has sent, repeats included; else those that came."""
        sent = self.counters.sent
        if sent is not None:
            return sent
        return self.before + self.frames + self.dropped + self.counters.skipped
