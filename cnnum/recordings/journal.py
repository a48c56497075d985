"""Recording of incoming frames, none of which stays in memory for more than a moment."""

import contextlib
import os
import time
from collections.abc import Sequence
from pathlib import Path
from threading import Event, Lock, Thread
from typing import IO

from cnnum.errors import RecordingError
from cnnum.frame import Frame
from cnnum.recordings.export import write_index
from cnnum.recordings.layout import Held, Layout, records
from cnnum.recordings.mcap_chunks import CHUNK_BYTES, ChunkMaker, RawMaker, Waiting, beginning
from cnnum.safety.files import create, sync_folder
from cnnum.tactile.taxel import Calibration


class ChunkFile:
    """An MCAP file being written.

    Parameters
    ----------
    path : Path
    held : sequence of Held
        Files that travel in it.

    Raises
    ------
    FileExistsError
        If there is such a file.
    OSError
        If it cannot be created.
    """

    def __init__(self, path: Path, held: Sequence[Held] = ()) -> None:
        self.path = path
        # unbuffered: a write is a call of the system, and nothing waits in a buffer of ours
        self._file: IO[bytes] = create(path)
        self._end = 0
        try:
            self.append(beginning() + records(held))
        except BaseException:
            self.discard()
            raise
        sync_folder(path.parent)

    def append(self, data: bytes) -> None:
        """Append data; a partly written chunk is removed.

        Raises
        ------
        OSError
            If there is no room, or the file is gone.
        """
        try:
            _write(self._file, data)
        except OSError:
            self._take_back()
            raise
        self._end += len(data)

    def sync(self) -> None:
        """Wait until all that was written is on the disk."""
        os.fsync(self._file.fileno())

    def close(self, layout: Layout | None) -> None:
        """Write the index, if a layout is given, and close the file.

        Raises
        ------
        OSError
            If there is no room for the index; the chunks are there.
        """
        try:
            self.sync()
            if layout is not None:
                self._write_index(layout)
                self.sync()
        finally:
            self._file.close()

    def discard(self) -> None:
        """Remove the file: one that was created here, and holds no frame."""
        self._file.close()
        self.path.unlink(missing_ok=True)

    def _write_index(self, layout: Layout) -> None:
        try:
            with os.fdopen(os.dup(self._file.fileno()), "rb+") as file:
                write_index(file, layout)
        except OSError:
            self._take_back()
            raise

    def _take_back(self) -> None:
        # a torn chunk cannot be read, and the chunks after it are to be found at once
        with contextlib.suppress(OSError):
            self._file.truncate(self._end)
            self._file.seek(self._end)


def _write(file: IO[bytes], data: bytes) -> None:
    """Write all data: a full disk accepts a part, and reports an error at the next call."""
    left = memoryview(data)
    while left:
        left = left[file.write(left) :]


MOMENT = 0.4
"""Seconds after which a frame that waits is written, and written ones are synced. A frame is on the
disk after two of them and the time that the disk takes. That is to be below a second."""


class Journal:
    """An MCAP file that frames are appended to in chunks, by time and by size.

    A thread writes the waiting frames when the source stalls, and syncs the file: the caller
    does not wait for the disk.

    Parameters
    ----------
    path : Path
    rate : float, Hz
        Rate of the array.
    calibration : Calibration or None
        Calibration of the array.
    held : sequence of Held
        Files that travel in it.

    Attributes
    ----------
    came, stored : int
        Frames that were added, and those of them that are in the file.
    failure : OSError or None
        The error that ended the writing, if any.

    Raises
    ------
    FileExistsError, OSError
        As `ChunkFile`.
    """

    def __init__(
        self,
        path: Path,
        rate: float,
        calibration: Calibration | None,
        held: Sequence[Held] = (),
        pads: int | None = None,
    ) -> None:
        self.path = path
        self.came = self.stored = 0
        self.failure: OSError | None = None
        self._rate, self._calibration, self._pads = rate, calibration, pads
        self._file = ChunkFile(path, held)
        self._maker: ChunkMaker | None = None
        self._raw = RawMaker()
        self._oldest = 0
        # a clock that is set while frames come must not shuffle them
        self._epoch = time.time_ns() - time.monotonic_ns()
        self._lock, self._ended = Lock(), Event()
        self._thread = Thread(target=self._keep_up, name="cnnum-journal", daemon=True)
        self._thread.start()

    def add(self, frame: Frame) -> None:
        """Add a frame.

        Raises
        ------
        RecordingError
            If the file takes no more, or the frame is of another shape than those before.
        """
        with self._lock:
            self.came += 1
            if self.failure is not None:
                raise _full(self.path, self.failure)
            maker, now = self._maker or self._begin(frame), time.monotonic_ns()
            if not maker.count:
                self._oldest = now
            maker.add(frame, self._epoch + now)
            if maker.size >= CHUNK_BYTES or now - self._oldest >= MOMENT * 1e9:
                self._write()
            if self.failure is not None:
                raise _full(self.path, self.failure)

    def add_raw(self, data: bytes, arrived: int) -> None:
        """Add raw bytes with their arrival time on the host's monotonic clock, ns.

        It never raises: the frames that are decoded from them say that the file takes no more.
        """
        with self._lock:
            if self.failure is None and not self._ended.is_set():
                self._raw.add(data, self._epoch + arrived)
                if self._raw.size >= CHUNK_BYTES:
                    self._write()

    def close(self, *, index: bool) -> None:
        """Write the waiting frames, and the index if it is wanted; then close the file.

        An error is in `failure`. A file without any frame is removed.
        """
        if self._ended.is_set():
            return
        self._ended.set()
        self._thread.join()
        with self._lock:
            self._write()
        if not self.stored:
            self._file.discard()
            return
        try:
            wanted = index and self.failure is None and self._maker is not None
            self._file.close(self._maker.layout if wanted and self._maker else None)
        except OSError as error:
            self.failure = self.failure or error

    def _begin(self, frame: Frame) -> ChunkMaker:
        self._maker = ChunkMaker(Layout.of(frame, self._rate, self._calibration, self._pads))
        return self._maker

    def _write(self) -> None:
        """Append the waiting frames, then the waiting bytes; the lock is held."""
        if self._maker is not None and self._maker.count and self.failure is None:
            self._store(self._maker.take())
        if self._raw.count and self.failure is None:
            try:
                self._file.append(self._raw.take().chunk())
            except OSError as error:
                self.failure = error

    def _store(self, waiting: Waiting) -> bool:
        """Append frames, as many as fit on a full disk."""
        try:
            self._file.append(waiting.chunk())
        except OSError as error:
            self.failure = error
            return all(self._store(half) for half in waiting.halves()) and bool(waiting.index[1:])
        self.stored += len(waiting.index)
        return True

    def _keep_up(self) -> None:
        synced = 0
        while not self._ended.wait(MOMENT):
            with self._lock:
                self._write()
                written = self.stored
            if written == synced or self.failure is not None:
                continue
            try:
                self._file.sync()
                synced = written
            except OSError as error:
                self.failure = error


def _full(path: Path, failure: OSError) -> RecordingError:
    return RecordingError(f"'{path}' cannot take more frames: {failure.strerror or failure}.")
