"""Files that frames are recorded to: whole at the end or not there at all."""

import csv
import os
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Protocol

import numpy as np

from cnnum.drivers.driver import Driver
from cnnum.drivers.npz_file import Recording, write_npz
from cnnum.errors import RecordingError, name_error
from cnnum.frame import Frame


class Recorder(Protocol):
    """A file in the making."""

    def add(self, frame: Frame) -> None:
        """Write a frame to the draft."""
        ...

    def finish(self, driver: Driver) -> None:
        """Turn the draft into the file that was asked for, in one step."""
        ...

    def discard(self) -> None:
        """Throw the draft away; nothing happens after `finish`."""
        ...


class _Draft:
    """A temporary file beside the wanted one: a rename is atomic only within a file system."""

    def __init__(self, target: Path) -> None:
        self.target = target
        try:
            handle, name = tempfile.mkstemp(
                prefix=f".{target.name}.", suffix=".part", dir=target.parent
            )
        except OSError as error:
            raise RecordingError(
                f"'{target}' can not be written: {error.strerror}; choose a folder that exists "
                "and may be written to."
            ) from None
        self.path, self.handle = Path(name), handle

    def replace(self) -> None:
        self.path.chmod(0o644)
        self.path.replace(self.target)

    def discard(self) -> None:
        self.path.unlink(missing_ok=True)


class CsvRecorder:
    """A row a frame: sequence, time, flags, then every cell's channels, then the ground truth."""

    def __init__(self, target: Path) -> None:
        self._draft = _Draft(target)
        self._file: IO[str] = os.fdopen(self._draft.handle, "w", newline="", encoding="utf-8")
        self._writer = csv.writer(self._file)
        self._truths: tuple[str, ...] | None = None

    def add(self, frame: Frame) -> None:
        """Write a row; numbers in the shortest form that is read back as the same."""
        if self._truths is None:
            self._truths = tuple(frame.truth.values) if frame.truth else ()
            self._writer.writerow(self._header(frame, self._truths))
        truths = [frame.truth.get(name) if frame.truth else "" for name in self._truths]
        self._writer.writerow(
            [
                frame.sequence,
                repr(float(frame.time)),
                int(frame.quality),
                *(repr(value) for value in frame.values.ravel().tolist()),
                *truths,
            ]
        )

    def _header(self, frame: Frame, truths: tuple[str, ...]) -> list[str]:
        rows, cols = frame.shape
        cells = [
            f"r{row}_c{col}_{channel} ({frame.unit})"
            for row in range(rows)
            for col in range(cols)
            for channel in frame.channels
        ]
        return ["sequence", "time (s)", "quality", *cells, *(f"truth {name}" for name in truths)]

    def finish(self, driver: Driver) -> None:
        """Close and rename."""
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()
        self._draft.replace()

    def discard(self) -> None:
        """Remove the draft."""
        self._file.close()
        self._draft.discard()


@dataclass(slots=True)
class _Notes:
    sequence: list[int] = field(default_factory=list[int])
    time: list[float] = field(default_factory=list[float])
    quality: list[int] = field(default_factory=list[int])
    truth: list[list[float]] = field(default_factory=list[list[float]])


class NpzRecorder:
    """An archive of arrays, which `cnnum replay` reads; cells wait on disk, not in memory."""

    def __init__(self, target: Path) -> None:
        self._draft = _Draft(target)
        self._spool: IO[bytes] = os.fdopen(self._draft.handle, "wb")
        self._notes = _Notes()
        self._truths: tuple[str, ...] = ()
        self._shape: tuple[int, ...] = ()

    def add(self, frame: Frame) -> None:
        """Write the cells, and note the rest."""
        notes = self._notes
        if not notes.sequence:
            self._shape = frame.values.shape
            self._truths = tuple(frame.truth.values) if frame.truth else ()
        self._spool.write(np.ascontiguousarray(frame.values).tobytes())
        notes.sequence.append(frame.sequence)
        notes.time.append(frame.time)
        notes.quality.append(int(frame.quality))
        truth = frame.truth.values if frame.truth else {}
        notes.truth.append([truth.get(name, np.nan) for name in self._truths])

    def finish(self, driver: Driver) -> None:
        """Write the archive beside the cells, then put it in its place."""
        self._spool.close()
        notes, count = self._notes, len(self._notes.sequence)
        values = np.memmap(self._draft.path, np.float64, "r", shape=(count, *self._shape))
        recording = Recording(
            values=values,
            channels=driver.channels,
            unit=driver.unit,
            rate=driver.rate,
            sequence=np.array(notes.sequence, np.int64),
            time=np.array(notes.time),
            quality=np.array(notes.quality, np.int64),
            truths=self._truths,
            truth=np.array(notes.truth).reshape(count, len(self._truths)),
            calibration=getattr(driver, "calibration", None),
        )
        archive = _Draft(self._draft.target)
        try:
            with os.fdopen(archive.handle, "wb") as file:
                write_npz(file, recording)
                file.flush()
                os.fsync(file.fileno())
            archive.replace()
        except BaseException:
            archive.discard()
            raise
        self._draft.discard()

    def discard(self) -> None:
        """Remove the draft."""
        self._spool.close()
        self._draft.discard()


RECORDERS: Mapping[str, Callable[[Path], Recorder]] = {".npz": NpzRecorder, ".csv": CsvRecorder}
"""By the suffix of the file."""


def open_recorder(target: Path) -> Recorder:
    """Begin a file.

    Raises
    ------
    UnknownNameError
        If its suffix is none of `RECORDERS`.
    RecordingError
        If its folder can not be written to.
    """
    suffix = target.suffix.lower()
    if suffix not in RECORDERS:
        raise name_error("kind of recording", suffix or target.name, RECORDERS)
    return RECORDERS[suffix](target)
