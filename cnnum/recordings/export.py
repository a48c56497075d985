"""From chunks to the file that was asked for: MCAP with an index, NumPy, CSV or HDF5."""

import contextlib
import os
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import IO

from cnnum.errors import RecordingError, missing_extra, name_error
from cnnum.recordings.csv_writer import write_table
from cnnum.recordings.hdf5_writer import write_hdf5
from cnnum.recordings.mcap_writer import write_mcap
from cnnum.recordings.npz_writer import write_archive
from cnnum.recordings.reader import Contents
from cnnum.safety.files import beside, sentences, written

WRITERS: Mapping[str, Callable[[IO[bytes], Contents], None]] = {
    ".mcap": write_mcap,
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
    MissingExtraError
        If its library is not installed: better before frames are recorded than after it.
    """
    suffix = target.suffix.lower()
    if suffix not in WRITERS:
        raise name_error("kind of recording", suffix or target.name, WRITERS)
    if WRITERS[suffix] is write_hdf5 and find_spec("h5py") is None:
        raise missing_extra("HDF5 files", "h5py", "hdf5")
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
    suffix, calibration = suffix_of(target), contents.layout.calibration
    with contextlib.ExitStack() as drafts:
        if suffix == ".csv" and calibration:  # its draft has found room when the table comes
            beside_it = calibration_of(target)
            file = drafts.enter_context(written(beside_it, error=RecordingError, force=force))
            with sentences(beside_it, RecordingError):
                file.write(calibration.encode("utf-8"))
                file.flush()
                os.fsync(file.fileno())
        with written(target, error=RecordingError, force=force) as file:
            WRITERS[suffix](file, contents)


def calibration_of(table: Path) -> Path:
    """Return the file with the calibration of the array whose frames a CSV file holds."""
    return beside(table.with_suffix(""), ".calibration.toml")
