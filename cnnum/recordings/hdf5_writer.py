"""Recordings as HDF5, for analysis: one array of all frames, and one of each of their facts."""

from importlib import import_module
from typing import IO, Any

import numpy as np

from cnnum.errors import missing_extra
from cnnum.recordings.reader import Contents

KIND = "cnnum recording 1"


def write_hdf5(file: IO[bytes], contents: Contents) -> None:
    """Write ``values`` (frames, rows, cols, channels), and numbers by frame.

    These are ``time`` (s), ``log_time`` (ns), ``sequence``, ``quality`` and ``truth/NAME``, a
    number a frame. Attributes say the rest. A chunk of the recording at a time is held.

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
    layout = contents.layout
    with h5py.File(file, "w") as target:
        target.attrs.update(
            {
                "kind": KIND,
                "axes": list(layout.channels),
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
            for number, name in enumerate(layout.truths):
                sets[f"truth/{name}"][part] = held["truth"][:, number]
            at += len(rows)


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
    found["values"] = target.create_dataset(
        "values",
        (frames, *layout.whole),
        np.float64,
        chunks=(min(256, frames), *layout.whole),
        compression="gzip",
        shuffle=True,
    )
    return found
