"""A file that chunks are appended to: created exclusively, and never shorter than its chunks."""

import contextlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import IO

from cnnum.recordings.attachments import Held, records
from cnnum.recordings.chunks import beginning
from cnnum.recordings.layout import Layout
from cnnum.recordings.mcap_index import write_index
from cnnum.safety.files import create, sync_folder


class ChunkFile:
    """An MCAP file in the making.

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
        """Write at the end; a part of a chunk is taken back.

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
    """Write all of it: a full disk takes a part, and says so at the next call."""
    left = memoryview(data)
    while left:
        left = left[file.write(left) :]
