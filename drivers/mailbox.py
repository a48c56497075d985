"""Frames from the thread that reads the port to the one that works on them."""

from collections import deque
from dataclasses import replace
from threading import Condition

from cnnum.frame import Frame, Quality


class Mailbox:
    """A bounded queue: when it is full the oldest frame goes, and that is counted.

    Parameters
    ----------
    depth : int
        Frames that may wait; 1 keeps the newest only.
    lost : bool
        Whether frames that go are lost, which the one after them is flagged with, or only skipped.
    """

    def __init__(self, depth: int, *, lost: bool = True) -> None:
        self._lost = Quality.DROPPED_BEFORE if lost else Quality.GOOD
        self._owed = Quality.GOOD  # flags of frames that went, for the next one
        self._frames: deque[Frame] = deque()
        self._depth = depth
        self._changed = Condition()
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
        """Leave a frame."""
        with self._changed:
            if len(self._frames) == self._depth:
                gone = self._frames.popleft()
                self._owed |= self._lost | (gone.quality & Quality.DROPPED_BEFORE)
                self._pushed_out += 1
            self._frames.append(frame)
            self._changed.notify()

    def end(self, error: Exception | None = None) -> None:
        """Note that no more frames come, and why; frames that wait can still be fetched."""
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
            if self._frames:
                owed, self._owed = self._owed, Quality.GOOD
                frame = self._frames.popleft()
                return replace(frame, quality=frame.quality | owed) if owed else frame
            if self._error is not None:
                raise self._error
            return None
