"""CSV and HDF5 files of cnnum itself, and those of a data frame's `to_csv`: they need no layout."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.drivers.own_data.hdf5_file import list_hdf5, read_hdf5
from cnnum.drivers.text_table import Columns, Head, Wanted, read_columns
from cnnum.errors import CalibrationError, CodecError, RecordingError, unreadable
from cnnum.recordings.chunks import untimed
from cnnum.recordings.csv_writer import CAME, MARKS, RATE
from cnnum.recordings.hdf5_writer import KIND
from cnnum.recordings.recording import Recording
from cnnum.recordings.times import rate_of
from cnnum.safety.names import shown
from cnnum.safety.reading import open_regular
from cnnum.tactile.taxel import Calibration

HEAD = ("sequence", "time (s)", "quality")
"""The first columns of what `cnnum record` writes."""

FRAME_HEAD = (b"time,sequence,quality,", b",time,sequence,quality,")
"""Those of a data frame, without and with its index."""

H5_ARRAYS, H5_LATER = ("values", "time", "sequence", "quality"), ("log_time", MARKS)
H5_TRUTH = "truth/"
"""Arrays of an HDF5 file: those that it must have, those that it may, and the ground truth."""

TRUTH, UNIT = "truth ", "unit"
_TAXEL = re.compile(r"r(\d{1,5})_c(\d{1,5})")
_CELL = re.compile(r"r(\d{1,5})_c(\d{1,5})_(.{1,80}) \((.{1,80})\)")
_FRAME_CELL = re.compile(r"(.{1,80})\[(\d{1,5}), (\d{1,5})\]")


def is_own_csv(path: Path) -> bool:
    """Return whether a CSV file is one of cnnum's.

    Raises
    ------
    RecordingError
        If it cannot be read.
    """
    try:
        with open_regular(path) as file:
            begin = file.read(64)
    except OSError as error:
        raise unreadable(RecordingError, f"'{path}'", error) from None
    return begin.startswith((",".join(HEAD).encode(), *FRAME_HEAD))


def read_own_csv(path: Path) -> Recording:
    """Return the recording of such a file.

    Without a column of it, the rate is that of the times, or 1 Hz of a single frame.

    Raises
    ------
    CodecError
        If columns are missing, or a field is not a number.
    RecordingError
        If it cannot be read.
    """
    form: list[_Form] = []

    def pick(head: Head) -> Wanted:
        form.append(_Form(head))
        return form[0].wanted

    held = read_columns(path, pick)
    own = form[0]
    values = held.cells[:, : own.cells].reshape(-1, *own.shape, len(own.channels))
    truth = held.cells[:, own.cells :]
    times = held.facts[:, 0]
    rate = float(held.facts[0, 1]) if RATE in held.head.names else 0.0
    return Recording(
        values,
        rate=rate or rate_of(times) or 1.0,
        unit=own.unit or next(iter(set(held.texts[UNIT]))),
        channels=own.channels,
        times=times,
        truth={name: truth[:, place] for place, name in enumerate(own.truths)},
        quality=held.whole["quality"],
        saturated=_saturated(held, own.shape),
        sequence=held.whole["sequence"],
        wall_ns=_came(held.whole.get(CAME), times),
    )


def _came(log_times: NDArray[np.int64] | None, times: Floats) -> NDArray[np.int64] | None:
    """Return when frames came, None where their log times are their times and no more."""
    if log_times is None or log_times.tolist() == [untimed(time) for time in times.tolist()]:
        return None
    return log_times


def read_own_hdf5(path: Path) -> tuple[Recording, Calibration | None] | None:
    """Return the recording of an HDF5 file and its calibration; None where it is not cnnum's.

    Raises
    ------
    CodecError
        If it is, and does not hold all parts of one.
    RecordingError, MissingExtraError
        As `read_hdf5`.
    """
    shapes, attributes = list_hdf5(path)
    if attributes.get("kind") != KIND:
        return None
    truths = [name for name in shapes if name.startswith(H5_TRUTH)]
    names = [*H5_ARRAYS, *(name for name in H5_LATER if name in shapes), *truths]
    _, held = read_hdf5(path, names)
    try:
        made = _recording(held, truths, attributes)
        text = str(attributes.get("calibration", ""))
        return made, Calibration.from_text(text, path) if text else None
    except (KeyError, TypeError, ValueError, CalibrationError) as error:
        raise CodecError(f"'{path}' is not a recording of cnnum: {error}") from None


def _recording(
    held: Mapping[str, NDArray[Any]], truths: list[str], attributes: Mapping[str, Any]
) -> Recording:
    for name in H5_ARRAYS:
        if name not in held:
            raise CodecError(f"it has no '{name}'.")
    channels, times = attributes["channels"], held["time"].astype(np.float64)
    listed = [channels] if isinstance(channels, str) else cast("list[Any]", channels)
    return Recording(
        held["values"],
        rate=float(attributes["rate"]),
        unit=str(attributes["unit"]),
        channels=[str(name) for name in listed],
        times=times,
        truth={name.removeprefix(H5_TRUTH): held[name] for name in truths},
        quality=held["quality"],
        saturated=held.get(MARKS),
        sequence=held["sequence"],
        wall_ns=_came(held.get("log_time"), times),
    )


class _Form:
    """The meaning of the columns of a file.

    Attributes
    ----------
    shape : (rows, cols)
    channels, truths : tuple of str
    unit : str
        Empty where a column says it.
    cells : int
        Numbers of a frame.
    wanted : Wanted
    """

    def __init__(self, head: Head) -> None:
        framed = "time" in head.names
        found = list(_framed(head) if framed else _recorded(head))
        if not found:
            raise CodecError(
                f"'{head.path}', line {head.line}: expected columns as 'r0_c0_normal (count)'."
            )
        rows = max(place[0] for place, _ in found) + 1
        cols = max(place[1] for place, _ in found) + 1
        self.shape = rows, cols
        self.channels = tuple(dict.fromkeys(place[2] for place, _ in found))
        self.unit = "" if framed else found[0][0][3]
        self.cells = rows * cols * len(self.channels)
        columns = {place[:3]: name for place, name in found}
        whole = len(columns) == len(found) == self.cells
        if not whole or len({place[3] for place, _ in found}) > 1:
            raise CodecError(
                f"'{head.path}', line {head.line}: expected the columns of every cell row by row, "
                f"from '{found[0][1]}' to '{found[-1][1]}'."
            )
        truths = [name for name in head.names if name.startswith(TRUTH)]
        self.truths = tuple(name.removeprefix(TRUTH) for name in truths)
        in_order = (
            columns[row, col, channel]
            for row in range(rows)
            for col in range(cols)
            for channel in self.channels
        )
        facts = ["time" if framed else HEAD[1], *([RATE] if RATE in head.names else [])]
        texts = [*([MARKS] if MARKS in head.names else []), *([UNIT] if framed else [])]
        marked = [CAME] if CAME in head.names else []
        self.wanted = Wanted(
            cells=[*in_order, *truths],
            facts=facts,
            texts=texts,
            whole=["sequence", "quality", *marked],
        )


Place = tuple[int, int, str, str]
"""Row, column, channel and unit of a column."""


def _recorded(head: Head) -> Iterator[tuple[Place, str]]:
    for name in head.names:
        if found := _CELL.fullmatch(name):
            yield (int(found[1]), int(found[2]), found[3], found[4]), name


def _framed(head: Head) -> Iterator[tuple[Place, str]]:
    for name in head.names:
        if found := _FRAME_CELL.fullmatch(name):
            yield (int(found[2]), int(found[3]), found[1], ""), name


def _saturated(held: Columns, shape: tuple[int, int]) -> NDArray[np.bool_] | None:
    """Return the marks of each frame; None where there is no column of them."""
    if MARKS not in held.texts:
        return None
    rows, cols = shape
    found = np.zeros((len(held.lines), rows, cols), np.bool_)
    for number, text in enumerate(held.texts[MARKS]):
        for name in text.split():
            cell = _TAXEL.fullmatch(name)
            if cell is None or int(cell[1]) >= rows or int(cell[2]) >= cols:
                raise CodecError(
                    f"'{held.head.path}', line {held.lines[number]}: expected taxels of "
                    f"{rows}×{cols} in the column '{MARKS}', as in 'r0_c3 r1_c3', got "
                    f"{shown(name)}."
                )
            found[number, int(cell[1]), int(cell[2])] = True
    return found
