"""The interface of every array driver, and the frames that wait for their reader."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from threading import Condition
from types import TracebackType
from typing import Protocol, Self

from cnnum.arrays import Shape
from cnnum.frame import Frame, Quality


class Mailbox:
    """A bounded queue that drops and counts its oldest frame when it is full.

    Parameters
    ----------
    depth : int
        Number of frames that may wait; 1 keeps only the newest.
    lost : bool
        Whether dropped frames are lost, so that the next frame is flagged, or only skipped.
    changed : Condition, optional
        Condition that several mailboxes of one reader share.
    """

    def __init__(self, depth: int, *, lost: bool = True, changed: Condition | None = None) -> None:
        self._lost = Quality.DROPPED_BEFORE if lost else Quality.GOOD
        self._owed = Quality.GOOD  # flags of frames that went, for the next one
        self._frames: deque[Frame] = deque()
        self._depth = depth
        self._changed = changed or Condition()
        self._ended = False
        self._error: Exception | None = None
        self._pushed_out = 0

    @property
    def pushed_out(self) -> int:
        """Frames lost because they were not fetched in time."""
        with self._changed:
            return self._pushed_out

    @property
    def waiting(self) -> int:
        """Frames that wait to be fetched."""
        with self._changed:
            return len(self._frames)

    def put(self, frame: Frame) -> None:
        """Add a frame."""
        with self._changed:
            if len(self._frames) == self._depth:
                gone = self._frames.popleft()
                self._owed |= self._lost | (gone.quality & Quality.DROPPED_BEFORE)
                self._pushed_out += 1
            self._frames.append(frame)
            self._changed.notify()

    def end(self, error: Exception | None = None) -> None:
        """Mark the end of the frames and its reason; waiting frames can still be fetched."""
        with self._changed:
            if not self._ended:
                self._ended, self._error = True, error
            self._changed.notify_all()

    def get(self) -> Frame | None:
        """Return the next frame, waiting for it; None after the end.

        Raises
        ------
        Exception
            The one that `end` was given, once the frames before it are fetched.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._frames or self._ended)
            return self.take()

    @property
    def ended(self) -> bool:
        """Whether no more frames come, and none waits."""
        with self._changed:
            return self._ended and not self._frames

    def take(self) -> Frame | None:
        """Return the next frame if one waits, else None; it raises as `get`."""
        with self._changed:
            if self._frames:
                owed, self._owed = self._owed, Quality.GOOD
                frame = self._frames.popleft()
                return replace(frame, quality=frame.quality | owed) if owed else frame
            if self._error is not None:
                raise self._error
            return None


@dataclass(frozen=True, slots=True)
class Counters:
    """Snapshot of the counts of a driver.

    For an array that numbers its scans, ``sent`` is ``frames + repeated + dropped + skipped +
    waiting``.

    Attributes
    ----------
    frames : int
        New scans that were delivered.
    bad : int
        Packets or rows whose check failed.
    dropped : int
        Scans that, by the device's numbers, did not arrive complete, including bad ones and
        those that a full queue dropped; in a recording, also rows that one of its files lacks.
    repeated : int
        Scans that arrived again and were marked as repeated.
    skipped : int
        Good scans passed over because a newer one was already there (mode "latest").
    resyncs : int
        Number of times that synchronisation was lost and regained.
    discarded : int
        Bytes that belonged to no good packet.
    gaps : int
        Interruptions of the connection, or restarts of the device. If the device then counts from
        0, ``dropped`` includes the scans of the interruption, estimated from its period and the
        host's clock.
    waiting : int
        Scans that have arrived but were not delivered yet.
    sent : int or None
        Scans that the device has sent according to its numbers, including repeats; None if it does
        not number them.
    """

    frames: int = 0
    bad: int = 0
    dropped: int = 0
    repeated: int = 0
    skipped: int = 0
    resyncs: int = 0
    discarded: int = 0
    gaps: int = 0
    waiting: int = 0
    sent: int | None = None


class Driver(Protocol):
    """A source of frames: an array at a port, a recording or a simulation.

    A driver may have further attributes, which are then used:

    * ``calibration`` is a `cnnum.tactile.taxel.Calibration`.
    * ``pitch`` is the distance between taxels, m.
    * ``pads`` is the number of skins side by side in the columns.
    * ``positions`` are the positions of the taxels, mm, if they are not on a square grid.
    * ``bumps`` is the `cnnum.tactile.cover.BumpCover` over the taxels. Its geometry is passed to
      the programs that compensate for it.
    * ``full_scale`` is the largest magnitude that a value can have. A frame with a larger one is
      a bad frame.
    * ``limits`` are the smallest and the largest value of a working taxel, one pair for all
      channels or one for each.
    * ``bandwidth`` is the highest frequency of loads, Hz.
    * ``live`` is true if frames cannot be read twice, so that a second pass over a scene raises an
      error. Otherwise, each call of `frames` begins at the first frame.
    * ``total_frames`` is the number of frames to come, for a progress bar.
    * ``verified`` is false if the packets of a protocol have no checksum.
    * ``clock`` compares the device's clock with the host's. Its ``drift`` is the relative gain of
      the host's clock.
    * ``tap`` is a method that takes a function, or None to remove it. The function is called with
      the bytes from a port as they arrive and the time, ns.
    """

    @property
    def shape(self) -> Shape:
        """Rows and columns of every frame."""
        ...

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of a frame's last axis."""
        ...

    @property
    def unit(self) -> str:
        """Unit of the values, such as "count" or "V"."""
        ...

    @property
    def rate(self) -> float:
        """Scan rate in Hz; 0 if it is not known."""
        ...

    @property
    def counters(self) -> Counters:
        """The counts so far."""
        ...

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in the order of their scans, until the source ends or is closed."""
        ...

    def close(self) -> None:
        """Close the source; a second call does nothing."""
        ...

    def __enter__(self) -> Self:
        """Return the driver itself."""
        ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
        /,
    ) -> None:
        """Close the driver."""
        ...


def lost_before(frame: Frame, last: int | None) -> int:
    """Return how many scans are missing between a frame and the previous one, by their numbers."""
    if last is None or not frame.quality & Quality.DROPPED_BEFORE:
        return 0
    return max(0, frame.sequence - last - 1)


class Closing:
    """Context manager that all drivers share; leaving the block closes the driver."""

    def close(self) -> None:
        """Close the source, which needs nothing here."""

    def __enter__(self) -> Self:
        """Return the driver itself."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Close the driver."""
        self.close()


class Counting(Closing):
    """Counts of a driver whose frames are all available, so that no packet can be bad."""

    def __init__(self) -> None:
        self._counters = Counters()

    @property
    def counters(self) -> Counters:
        """The counts so far."""
        return self._counters

    def count(self, *, repeated: bool = False, dropped: int = 0) -> None:
        """Count a frame, and the scans that are lost before it."""
        seen = self._counters
        self._counters = replace(
            seen,
            frames=seen.frames + (not repeated),
            repeated=seen.repeated + repeated,
            dropped=seen.dropped + dropped,
        )
