"""Bytes as they come from a port, for a recorder that joins after the first of them."""

from collections import deque
from collections.abc import Callable
from threading import Lock

Take = Callable[[bytes, int], object]
"""Is given bytes, and when they came by the host's monotonic clock, ns."""

EARLY = 1 << 20
"""Bytes that are kept until it is known whether they are wanted."""


class Tap:
    """Hands bytes on; those that came before anyone was there are handed on first."""

    def __init__(self) -> None:
        self._early: deque[tuple[bytes, int]] | None = deque()
        self._size = 0
        self._take: Take | None = None
        self._lock = Lock()

    def add(self, data: bytes, arrived: int) -> None:
        """Take in bytes."""
        with self._lock:
            if self._take is not None:
                self._take(data, arrived)
            elif self._early is not None:
                self._early.append((data, arrived))
                self._size += len(data)
                while self._size > EARLY:
                    self._size -= len(self._early.popleft()[0])

    def begin(self) -> None:
        """Forget the early bytes: frames are taken, and no one has asked for bytes."""
        if self._early is not None:
            self.to(None)

    def to(self, take: Take | None) -> None:
        """Pass all bytes to `take` from now on, or to nobody if it is None."""
        with self._lock:
            early, self._early, self._take = self._early or (), None, take
            if take is not None:
                for data, arrived in early:
                    take(data, arrived)
