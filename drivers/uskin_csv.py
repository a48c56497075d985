"""Replay of a trial of two XELA uSkin pads that was written to CSV files.

The layout is that of the public data set of imanlab/proactive-slip-control: one folder per trial.
``xela_sensor1.csv`` and ``xela_sensor2.csv`` hold raw counts of 4×4 three-axial taxels, one after
the other, row by row. ``robot_state.csv`` has the time in s in its column ``time``,
``slip_label.csv`` has slip and fail, and ``meta_data.csv`` the rate. The first rows of all files
belong together; logs do not always end in the same row.
"""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.drivers.driver import Counters, Counting
from cnnum.drivers.options import require
from cnnum.drivers.text_table import TextTable, read_table
from cnnum.errors import CodecError, RecordingError, RecordingWarning
from cnnum.frame import FORCE_AXES, Frame, Quality, Truth
from cnnum.recordings.times import FASTEST, rate_of
from cnnum.safety.reading import names_something

SIDE = 4
"""Rows and columns of a pad."""

HEADER = tuple(f"txl{n}_{axis}" for n in range(1, SIDE * SIDE + 1) for axis in "xyz")
"""Columns of a pad's file."""

PAD_FILES = ("xela_sensor1.csv", "xela_sensor2.csv")
STATES, LABELS, META = "robot_state.csv", "slip_label.csv", "meta_data.csv"

MOST_ROWS, MOST_SHARE = 5, 0.01
"""Rows by which a file may be longer or shorter than the first pad's; one row in a short trial.

Five rows pass in 0.08 s, while the logs are closed one after the other. Files that differ by more
lack rows in between, or are of two trials: their rows would not belong together."""

LISTED = 4
"""Trials that are named where a folder of trials is given instead of one."""

ENDS = (0.0, 65535.0)
"""Range of a count: unsigned, 16 bits."""


@dataclass(frozen=True, slots=True)
class UskinCsvOptions:
    """Options of the driver "uskin-csv".

    Attributes
    ----------
    path : Path
        Folder of the trial.
    pad : 1, 2 or "both"
        One pad gives frames of shape (4, 4). "both" gives (4, 8), with pad 1 in columns 0–3 and pad
        2 in columns 4–7, so that one frame is one instant of the grasp. The pads are on opposite
        fingers, so neither a neighbourhood across columns 3 and 4 nor a sum of the shears of both
        pads is meaningful. Choose one pad if that matters.
    rate : float, optional
        Frame rate in Hz, for a trial that has neither times in ``robot_state.csv`` nor
        ``meta_data.csv``.
    """

    path: Path
    pad: Literal[1, 2, "both"] = "both"
    rate: float | None = None

    def __post_init__(self) -> None:
        holds = self.rate is None or 0 < self.rate < FASTEST
        require("rate", holds, f"Hz above 0, below {FASTEST:g}", self.rate)
        if not (names_something(self.path) and self.path.is_dir()):
            raise RecordingError(
                f"The option 'path' must name the folder of a trial, but there is no folder "
                f"'{self.path}'."
            )

    def open(self) -> "UskinCsv":
        """Read the trial.

        Raises
        ------
        RecordingError
            If a file is missing or cannot be read, or the folder is one of several trials.
        CodecError
            If a file has another format; the message names the file and the line.

        Warns
        -----
        RecordingWarning
            If the files differ in length; it counts the rows that are left out.
        """
        refuse_several(self.path)
        return UskinCsv(self)


class UskinCsv(Counting):
    """A trial, read whole; every row becomes a frame, a row that repeats the last one too.

    The log is faster than the sensor: such a row is flagged `Quality.REPEATED`, keeps the
    sequence number of the scan that it repeats, and is counted apart. Rows at the end that not all
    files have are no frames: those of a pad are counted as dropped when the last frame is read.
    """

    def __init__(self, options: UskinCsvOptions) -> None:
        super().__init__()
        names = PAD_FILES if options.pad == "both" else (PAD_FILES[options.pad - 1],)
        pads = [read_table(options.path / name) for name in names]
        states, labels = _states(options.path), _known(options.path / LABELS)
        used = [*pads, *(table for table in (states, labels) if table is not None)]
        rows = _common_rows(used)
        self._dropped = max(len(table.rows) for table in pads) - rows
        self._values = np.concatenate([_counts(t.first(rows)) for t in pads], axis=2)
        self._repeats = _repeats(self._values)
        self._times, self.rate = _clock(options, states, rows)
        self._truths = [] if labels is None else _truths(labels.first(rows))
        self.shape: Shape = (SIDE, SIDE * len(pads))
        self.channels = FORCE_AXES
        self.pads = len(pads)
        self.unit = "count"
        self.full_scale = ENDS[1]
        self.total_frames = rows

    def frames(self) -> Iterator[Frame]:
        """Yield one frame per row, as fast as they are fetched; a second call starts again."""
        self._counters = Counters()
        numbers = np.cumsum(~self._repeats) - 1
        for row, values in enumerate(self._values):
            again = bool(self._repeats[row])
            self.count(repeated=again)
            at_end = np.asarray(np.isin(values, ENDS).any(axis=-1))
            yield Frame(
                values=values,
                channels=self.channels,
                unit=self.unit,
                sequence=int(numbers[row]),
                time=float(self._times[row]),
                quality=_quality(at_end, again=again),
                truth=self._truths[row] if self._truths else None,
                saturated=at_end if at_end.any() else None,
            )
        self._counters = replace(self._counters, dropped=self._dropped)


def _counts(table: TextTable) -> Floats:
    """Return (rows, 4, 4, 3) counts."""
    if table.header != HEADER:
        raise CodecError(
            f"'{table.path}', line 1: expected the {len(HEADER)} columns "
            f"'{HEADER[0]}' to '{HEADER[-1]}', got {len(table.header)} from '{table.header[0]}'."
        )
    return table.numbers(HEADER).reshape(-1, SIDE, SIDE, len(FORCE_AXES))


def refuse_several(folder: Path) -> None:
    """Raise if a folder is not a trial, but has trials in it."""
    if any(names_something(folder / name) for name in PAD_FILES):
        return
    pads = sorted({file.parent.name for name in PAD_FILES for file in folder.glob(f"*/{name}")})
    if pads:
        names = ", ".join(f"'{name}'" for name in pads[:LISTED])
        more = f" and {len(pads) - LISTED} more" if len(pads) > LISTED else ""
        raise RecordingError(
            f"'{folder}' is a folder of {len(pads)} trial(s), not one: name one of them "
            f"({names}{more})."
        )
    inside = sorted(file.name for file in folder.glob("*.mcap"))
    raise RecordingError(
        f"'{folder}' is not a trial: expected a folder with "
        f"{' or '.join(map(repr, PAD_FILES))}, named by 'array.path', as in "
        "'--set array.path=FOLDER', or with bags of ROS (*.bag, *.db3, metadata.yaml)"
        f"{f'; name {inside[0]!r} in it' if inside else ''}."
    )


def _known(path: Path) -> TextTable | None:
    return read_table(path) if names_something(path) else None


def _states(folder: Path) -> TextTable | None:
    """Return the table with the times of rows, None where there is none."""
    table = _known(folder / STATES)
    return table if table is not None and "time" in table.header else None


def _common_rows(tables: list[TextTable]) -> int:
    """Return how many rows all files have, and warn of the rows that this leaves out."""
    rows = len(tables[0].rows)
    most = min(MOST_ROWS, max(1, int(MOST_SHARE * rows)))
    for table in tables:
        if abs(len(table.rows) - rows) > most:
            raise CodecError(
                f"'{table.path}', line {table.lines[-1]}: expected {rows} rows as in "
                f"'{tables[0].path.name}', give or take {most}, got {len(table.rows)}."
            )
    common = min(len(table.rows) for table in tables)
    out = {table.path.name: len(table.rows) - common for table in tables}
    if any(out.values()):
        counted = ", ".join(f"{count} of '{name}'" for name, count in out.items() if count)
        warnings.warn(
            f"The files of '{tables[0].path.parent}' end in different rows: {common} rows are "
            f"read, and the last rows of the longer files are left out ({counted}).",
            RecordingWarning,
            stacklevel=2,
        )
    return common


def _repeats(values: Floats) -> np.ndarray:
    """Return for each row whether it is the one before once more, on every pad."""
    same = (values[1:] == values[:-1]).all(axis=(1, 2, 3))
    return np.concatenate([[False], same])


def _quality(at_end: NDArray[np.bool_], *, again: bool) -> Quality:
    flags = Quality.SATURATED if at_end.any() else Quality.GOOD
    return flags | Quality.REPEATED if again else flags


def _clock(options: UskinCsvOptions, states: TextTable | None, rows: int) -> tuple[Floats, float]:
    """Return the rows' times from the first one (s), and the rate (Hz)."""
    meta = options.path / META
    if states is not None:
        times = states.first(rows).numbers(["time"])[:, 0]
        if (np.diff(times) < 0).any():
            line = states.lines[int(np.argmax(np.diff(times) < 0)) + 1]
            raise CodecError(
                f"'{states.path}', line {line}: expected a time later than the previous one."
            )
        return times - times[0], _rate(options, meta, times)
    rate = _rate(options, meta, np.zeros(1))
    if rate == 0.0:
        raise RecordingError(
            f"'{options.path}' has no times, neither as a column 'time' of '{STATES}' nor from a "
            f"rate in '{META}': give the option 'rate'."
        )
    return np.arange(rows) / rate, rate


def _rate(options: UskinCsvOptions, meta: Path, times: Floats) -> float:
    """Return the rate that was asked for, written down, or seen; 0 if there is none."""
    if options.rate is not None:
        return options.rate
    if names_something(meta):
        table = read_table(meta)
        rate = float(table.numbers(["frequency_hz"])[0, 0])
        if not 0 < rate < FASTEST:
            raise CodecError(
                f"'{meta}', line {table.lines[0]}: expected a 'frequency_hz' above 0, below "
                f"{FASTEST:g}, got {rate}."
            )
        return rate
    return rate_of(times)


def _truths(table: TextTable) -> list[Truth]:
    """Return one truth per row."""
    names = ("slip", "fail")
    return [Truth(dict(zip(names, row.tolist(), strict=True))) for row in table.numbers(names)]
