"""Recordings as NumPy archives, written member by member without ever being in memory."""

import zipfile
from collections.abc import Iterable, Iterator
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from cnnum.recordings.decode import marks_of
from cnnum.recordings.reader import Contents

KIND = "cnnum recording 1"

FRAMES = ("values", "sequence", "time", "quality", "truth")
"""Members with a row a frame."""

MARKS = "saturated"
"""Another one, (frames, rows, cols): taxels at an end of their range. It was not always there."""

CAME = "log_time"
"""And another, (frames,): when each came by the time of day, ns. It was not always there, either.
"""

CALIBRATION = ("alpha_normal", "beta_ns", "limit", "offsets", "cross", "drift")
"""Fields of a calibration that are members; its depth and heat are, too."""


def write_archive(file: IO[bytes], contents: Contents) -> None:
    """Write the archive that `cnnum.drivers.npz_file` reads.

    The recording is read once for each member that has a row a frame: a chunk at a time is held.

    It raises as `cnnum.recordings.mcap_writer.write_mcap`.
    """
    layout = contents.layout
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        for name, value in _facts(contents).items():
            _member(archive, name, np.asarray(value))
        shapes = {"values": layout.whole, "truth": (len(layout.truths),)}
        for name in (*FRAMES, CAME):
            shape = (contents.frames, *shapes.get(name, ()))
            kind = np.dtype(np.int64 if name in ("sequence", "quality", CAME) else np.float64)
            _stream(archive, name, shape, kind, _columns(contents, name, kind))
        marks = (marks_of(rows, layout).tobytes() for rows in contents.chunks())
        _stream(archive, MARKS, (contents.frames, *layout.shape), np.dtype(np.bool_), marks)


def _facts(contents: Contents) -> dict[str, Any]:
    layout = contents.layout
    facts: dict[str, Any] = {
        "kind": KIND,
        "channels": list(layout.channels),
        "unit": layout.unit,
        "rate": layout.rate,
        "truths": np.array(layout.truths, dtype=np.str_),
    }
    known = layout.calibrated(contents.path)
    if known is not None:
        parts: dict[str, Any] = {name: getattr(known, name) for name in CALIBRATION}
        parts["depth"] = np.nan if known.depth is None else known.depth
        parts["heat"] = [known.heat.amplitude, known.heat.time_constant]
        facts |= {f"calibration_{name}": value for name, value in parts.items()}
    return facts


def _columns(contents: Contents, name: str, kind: np.dtype[Any]) -> Iterator[bytes]:
    for rows in contents.chunks():
        held: Any = rows
        if name == "truth" and not contents.layout.truths:
            continue
        yield np.ascontiguousarray(held[name], kind).tobytes()


def _member(archive: zipfile.ZipFile, name: str, value: NDArray[Any]) -> None:
    _stream(archive, name, value.shape, value.dtype, [value.tobytes()])


def _stream(
    archive: zipfile.ZipFile,
    name: str,
    shape: tuple[int, ...],
    kind: np.dtype[Any],
    parts: Iterable[bytes],
) -> None:
    head = {
        "descr": np.lib.format.dtype_to_descr(kind),
        "fortran_order": False,
        "shape": shape,
    }
    with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
        np.lib.format.write_array_header_1_0(member, head)
        for part in parts:
            member.write(part)
