"""Recordings as HDF5, for analysis: one array of all frames, and one of each of their facts."""

import io
import os
from importlib import import_module
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from cnnum.errors import missing_extra
from cnnum.recordings.decode import marks_of
from cnnum.recordings.reader import Contents

if TYPE_CHECKING:
    from typing_extensions import Buffer

KIND = "cnnum recording 1"


def write_hdf5(file: IO[bytes], contents: Contents) -> None:
    """Write ``values`` (frames, rows, cols, channels), ``saturated``, and numbers by frame.

    ``saturated`` (frames, rows, cols) are the taxels at an end of their range. The numbers are
    ``time`` (s), ``log_time`` (ns), ``sequence``, ``quality`` and ``truth/NAME``. Attributes say
    the rest. A chunk of the recording at a time is held.

    Raises
    ------
    MissingExtraError
        If h5py is not installed.
    OSError
        If there is no room.
    RecordingError, CodecError
        If the recording can no longer be read.
    """
    try:
        h5py: Any = import_module("h5py")
    except ImportError:
        raise missing_extra("HDF5 files", "h5py", "hdf5") from None
    layout, steady = contents.layout, _Steady(file)
    with h5py.File(steady, "w") as target:
        target.attrs.update(
            {
                "kind": KIND,
                "channels": list(layout.channels),
                "unit": layout.unit,
                "rate": layout.rate,
                "calibration": layout.calibration,
            }
        )
        sets = _sets(target, contents)
        at = 0
        for rows in contents.chunks():
            held: Any = rows
            part = slice(at, at + len(rows))
            for name in ("values", "time", "log_time", "sequence", "quality"):
                sets[name][part] = held[name]
            sets["saturated"][part] = marks_of(rows, layout)
            for number, name in enumerate(layout.truths):
                sets[f"truth/{name}"][part] = held["truth"][:, number]
            at += len(rows)
            if steady.error is not None:
                break
    if steady.error is not None:
        raise steady.error


class _Steady(io.RawIOBase):
    """A file whose writes never fail: HDF5 ends the process that has a full disk below it.

    What no longer fits is held in memory, so that HDF5 reads what it wrote and can close the file.
    The first error is kept, and whoever writes stops by it.
    """

    def __init__(self, file: IO[bytes]) -> None:
        super().__init__()
        self._handle, self._at, self._end = file.fileno(), 0, 0
        self._late: list[tuple[int, bytes]] = []
        self.error: OSError | None = None

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._at

    def seek(self, offset: int, whence: int = 0) -> int:
        self._at = offset + (0, self._at, self._end)[whence]
        return self._at

    def truncate(self, size: int | None = None) -> int:
        self._end = self._at if size is None else size
        try:
            os.ftruncate(self._handle, self._end)
        except OSError as error:
            self.error = self.error or error
        return self._end

    def readinto(self, buffer: "Buffer") -> int:
        view = memoryview(buffer).cast("B")
        count = max(0, min(len(view), self._end - self._at))
        os.lseek(self._handle, self._at, os.SEEK_SET)
        got = os.read(self._handle, count) if count else b""
        view[:count] = got + bytes(count - len(got))
        for at, late in self._late:
            first, last = max(at, self._at), min(at + len(late), self._at + count)
            if first < last:
                view[first - self._at : last - self._at] = late[first - at : last - at]
        self._at += count
        return count

    def write(self, data: "Buffer") -> int:
        view = memoryview(data).cast("B")
        try:
            os.lseek(self._handle, self._at, os.SEEK_SET)
            done = 0
            while self.error is None and done < len(view):
                done += os.write(self._handle, view[done:])
        except OSError as error:
            self.error = error
        if self.error is not None:
            self._late.append((self._at, bytes(view)))
        self._at += len(view)
        self._end = max(self._end, self._at)
        return len(view)


def _sets(target: Any, contents: Contents) -> dict[str, Any]:
    """Return the empty arrays of a file by name."""
    layout, frames = contents.layout, contents.frames
    kinds: dict[str, Any] = {
        "time": np.float64,
        "log_time": np.int64,
        "sequence": np.int64,
        "quality": np.uint32,
        **{f"truth/{name}": np.float64 for name in layout.truths},
    }
    found = {name: target.create_dataset(name, (frames,), kind) for name, kind in kinds.items()}
    maps = (("values", layout.whole, np.float64), ("saturated", layout.shape, np.bool_))
    for name, shape, kind in maps:
        found[name] = target.create_dataset(
            name,
            (frames, *shape),
            kind,
            chunks=(min(256, frames), *shape),
            compression="gzip",
            shuffle=True,
        )
    return found
