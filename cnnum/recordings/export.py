"""From chunks to the file that was asked for: MCAP with an index, NumPy, CSV or HDF5."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO

from cnnum.errors import name_error
from cnnum.recordings.attachments import records
from cnnum.recordings.chunks import CHUNK_BYTES, ChunkMaker, beginning
from cnnum.recordings.csv_table import write_table
from cnnum.recordings.hdf5_writer import write_hdf5
from cnnum.recordings.index import write_index
from cnnum.recordings.npz_writer import write_archive
from cnnum.recordings.place import placed
from cnnum.recordings.raw_chunks import RawMaker
from cnnum.recordings.reader import Contents


def write_chunks(file: IO[bytes], contents: Contents) -> None:
    """Write files, frames and raw bytes to chunks anew, and the index.

    Raises
    ------
    OSError
        If there is no room.
    RecordingError, CodecError
        If the recording can no longer be read.
    """
    file.write(beginning() + records(contents.held))
    maker, raw = ChunkMaker(contents.layout), RawMaker()
    for frame, log_time in contents.stored():
        maker.add(frame, log_time)
        if maker.size >= CHUNK_BYTES:
            file.write(maker.end())
    if maker.count:
        file.write(maker.end())
    for log_time, data in contents.raw():
        raw.add(data, log_time)
        if raw.size >= CHUNK_BYTES:
            file.write(raw.take().chunk())
    if raw.count:
        file.write(raw.take().chunk())
    write_index(file, contents.layout)


WRITERS: Mapping[str, Callable[[IO[bytes], Contents], None]] = {
    ".mcap": write_chunks,
    ".npz": write_archive,
    ".csv": write_table,
    ".h5": write_hdf5,
    ".hdf5": write_hdf5,
}
"""By the suffix of the file."""


def suffix_of(target: Path) -> str:
    """Return the suffix that names the kind of recording of a file.

    Raises
    ------
    UnknownNameError
        If it is none of `WRITERS`.
    """
    suffix = target.suffix.lower()
    if suffix not in WRITERS:
        raise name_error("kind of recording", suffix or target.name, WRITERS)
    return suffix


def export(contents: Contents, target: Path, *, force: bool = False) -> None:
    """Write the frames of a recording to another file, which appears when it is whole.

    The calibration of an array goes into a file next to a CSV file, which has no place for it.

    Parameters
    ----------
    contents : Contents
    target : Path
        Its suffix names the kind of file.
    force : bool
        Whether a file that is there already is replaced.

    Raises
    ------
    UnknownNameError
        If the suffix is none of `WRITERS`.
    RecordingError
        If there is such a file, or no room, or the recording can no longer be read.
    CodecError
        If the recording is none.
    """
    suffix = suffix_of(target)
    with placed(target, force=force) as file:
        WRITERS[suffix](file, contents)
    if suffix == ".csv" and contents.layout.calibration:
        with placed(calibration_of(target), force=force) as file:
            file.write(contents.layout.calibration.encode())


def calibration_of(table: Path) -> Path:
    """Return the file with the calibration of the array whose frames a CSV file holds."""
    return table.with_suffix(".calibration.toml")
