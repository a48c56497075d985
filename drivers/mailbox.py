"""Frames from the thread that reads the port to the one that works on them."""

from collections import deque
from threading import Condition

from cnnum.frame import Frame


class Mailbox:
    """A bounded queue: when it is full the oldest frame goes, and that is counted.

    Parameters
    ----------
    depth : int
        Frames that may wait; 1 keeps the newest only.
    """

    def __init__(self, depth: int) -> None:
        self._frames: deque[Frame] = deque()
        self._depth = depth
        self._changed = Condition()
        self._ended = False
        self._error: Exception | None = None
        self._pushed_out = 0

    @property
    def pushed_out(self) -> int:
        """Frames that went because nobody fetched them in time."""
        with self._changed:
            return self._pushed_out

    def put(self, frame: Frame) -> None:
        """Leave a frame."""
        with self._changed:
            if len(self._frames) == self._depth:
                self._frames.popleft()
                self._pushed_out += 1
            self._frames.append(frame)
            self._changed.notify()

    def end(self, error: Exception | None = None) -> None:
        """Tell that nothing more comes, and why; frames that wait can still be fetched."""
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
                return self._frames.popleft()
            if self._error is not None:
                raise self._error
            return None
